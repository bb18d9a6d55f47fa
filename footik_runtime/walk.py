"""Walk: a headless run of one character through a scene, recorded for the measures."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from numbers import Real
from typing import Any

import mujoco
import numpy as np
from numpy.typing import ArrayLike, NDArray

from footik_runtime import quat_arrays as qa
from footik_runtime.character import stretched_offsets
from footik_runtime.crowd import Crowd, stays_in_place
from footik_runtime.errors import FootIKError
from footik_runtime.feet.record import GROUNDED, ON_HEEL
from footik_runtime.ground import ABOVE, REACH, SceneGround
from footik_runtime.hinge_pose import HingePose
from footik_runtime.motion import Motion
from footik_runtime.phases import Phase
from footik_runtime.recorded import Run
from footik_runtime.scene import Scene
from footik_runtime.settings import FootIKSettings, body_size, settings_or_default
from footik_runtime.sole import BALL, all_sole_points

Array = NDArray[np.float64]

Drive = Callable[[float], tuple[ArrayLike, float]]

_MOST_FRAMES = 1_000_000
_HEEL_OFF = 0.01  # rad that the runtime lifts a heel from which the ball alone carries
"""Of a recording: some 10 GB for a skeleton of 31 joints."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Recording:
    """What a run left behind, T frames of one character.

    Attributes:
        fps: frames a second.
        times: (T,) s.
        roots: (T, 3) joint 0 in the world, m.
        rotations: (T, J, 4) local, wxyz; a robot's as its joints have them.
        bodies: (T,) of `locomotion.BODY`.
        feet: (T, legs) of `feet.record.FOOT`.
        phases: (T, legs) the motion's contact phases.
        run: what the measures need.
    """

    fps: float
    times: Array
    roots: Array
    rotations: Array
    bodies: NDArray[Any]
    feet: NDArray[Any]
    phases: NDArray[np.int64]
    run: Run


def record_walk(
    scene: Scene,
    *,
    seconds: float,
    fps: float = 60.0,
    settings: FootIKSettings | None = None,
    ik: bool = True,
    speed: float | None = None,
    drive: Drive | None = None,
    each_frame: Callable[[int, int], None] = lambda frame, frames: None,
) -> Recording:
    """Let the scene's character walk on for some seconds, from the terrain's start, facing +x.

    Args:
        scene: with the motion that is walked; it is left where the walk ends.
        seconds: how long.
        fps: frames a second.
        settings: of the feet.
        ik: False leaves the animation as it is, on the same path: the untouched input.
        speed: m/s along the motion's own direction; the motion's own by default.
        drive: time, s -> the commanded velocity (2,), m/s in the root's frame, and turn rate,
            rad/s; instead of `speed`.
        each_frame: told (frame, frames) after each frame.

    Raises:
        FootIKError: seconds or fps are not positive and finite, or a pose became not finite.
    """
    if not (isinstance(seconds, Real) and np.isfinite(seconds) and seconds > 0.0):
        raise FootIKError(f"seconds must be positive and finite, not {seconds}.")
    if not (isinstance(fps, Real) and 1.0 <= fps <= 10000.0):
        raise FootIKError(f"fps must be in [1, 10000], not {fps}.")
    if seconds * fps > _MOST_FRAMES:
        raise FootIKError(
            f"a recording holds at most {_MOST_FRAMES} frames, {_MOST_FRAMES / fps:g} s at "
            f"{fps:g} Hz, not {seconds:g} s."
        )
    settings = settings_or_default(settings)
    ground = scene.ground(settings.groups)
    crowd = Crowd(scene.motion, ground, settings=settings)
    crowd.bodies["enabled"] = int(ik)
    crowd.place(np.asarray(scene.terrain.start_w)[None])
    if speed is not None:
        crowd.command(_at_speed(scene.motion, speed))
    frames = max(round(seconds * fps), 2)
    tape = _Tape(scene, frames, ik)
    hinges = scene.hinge_pose()
    for frame in range(frames):
        scene.pose_terrain(frame / fps)
        if drive is not None:
            crowd.command(*drive(frame / fps))
        dt = 1.0 / fps if frame else 0.0
        crowd.step(dt)
        if hinges is not None:
            hinges.write(scene.data, crowd, dt)
            mujoco.mj_kinematics(scene.model, scene.data)
        tape.take(frame, crowd, ground, hinges)
        each_frame(frame, frames)
    return tape.recording(fps, even=drive is None)


def _at_speed(motion: Motion, speed: float) -> Array:
    """The motion's velocity (2,) scaled to a speed."""
    if not (isinstance(speed, Real) and 0.0 <= speed <= 20.0):
        raise FootIKError(f"speed must be in [0, 20] m/s, not {speed}.")
    if stays_in_place(motion) and speed > 0.0:
        raise FootIKError(f"{motion.clip.name} stays in place: it cannot go at {speed:g} m/s.")
    return motion.velocity * (speed / max(motion.speed, 1e-9))


def _phases_at(motion: Motion, rate: float, times: Array) -> NDArray[np.int64]:
    """(N, legs) the motion's phases at times (N,) of a run that plays it at a constant rate."""
    frames = np.mod(times * rate, motion.clip.duration) * motion.clip.fps
    return motion.timing["phase"][np.floor(frames + 1e-6).astype(int)].astype(np.int64)


def _carried(
    phases_at: Callable[[Array], NDArray[np.int64]], times: Array, on_ball: NDArray[np.bool_]
) -> Callable[[Array], NDArray[np.int64]]:
    """Phases at times, with the ball phase wherever a run's foot stood on its ball alone."""

    def at(asked: Array) -> NDArray[np.int64]:
        phases = phases_at(asked)
        nearest = np.clip(np.rint(np.interp(asked, times, np.arange(len(times)))), 0, None)
        return _on_ball(phases, on_ball[nearest.astype(int)])

    return at


def _on_ball(phases: NDArray[np.int64], on_ball: NDArray[np.bool_]) -> NDArray[np.int64]:
    """The clip's phases (N, legs); a contact whose heel was lifted is in its ball phase."""
    return np.where((phases != Phase.SWING) & on_ball, int(Phase.BALL), phases)


class _Tape:
    """Collects frames; the sole points and the ground under them are found frame by frame,
    because the ground may move.
    """

    def __init__(self, scene: Scene, frames: int, ik: bool) -> None:
        self._ik = ik
        rig = scene.motion.rig
        joints, legs = len(rig.skeleton), len(rig.legs)
        self._scene = scene
        self._roots = np.zeros((frames, 3))
        self._rotations = np.zeros((frames, joints, 4))
        self._bodies: list[Any] = []
        self._feet: list[Any] = []
        self._phases = np.zeros((frames, legs), np.int64)
        self._sole = np.zeros((frames, legs, 3, 3))
        self._ground = np.zeros((frames, legs, 3))
        self._joints = np.zeros((frames, joints, 3))
        self._frame_at = np.zeros((frames, legs, 3))
        self._frame_turn = np.tile([1.0, 0.0, 0.0, 0.0], (frames, legs, 1))
        self._frame_id = np.zeros((frames, legs), np.int64)

    def take(self, frame: int, crowd: Crowd, ground: SceneGround, hinges: HingePose | None) -> None:
        rig = self._scene.motion.rig
        root, rotations, positions, turns = self._pose(crowd, hinges)
        if not np.isfinite(rotations).all() or not np.isfinite(root).all():
            raise FootIKError(f"the pose is not finite in frame {frame}.")
        self._roots[frame], self._rotations[frame] = root, rotations
        self._bodies.append(crowd.bodies[0].copy())
        self._feet.append(crowd.feet[0].copy())
        self._phases[frame] = self._scene.motion.timing["phase"][crowd.bodies[0]["frame"]]
        self._joints[frame] = positions[0]
        self._sole[frame] = all_sole_points(rig, positions, turns)[0]
        # The body each foot is over: what lies under its ball.
        points = self._sole[frame].reshape(-1, 3)
        size = body_size(rig)
        heights, geoms = ground.under(points, above=ABOVE * size, reach=REACH * size)
        self._ground[frame] = heights.reshape(self._ground[frame].shape)
        body = np.where(geoms >= 0, self._scene.model.geom_bodyid[geoms], 0)
        body = body.reshape(self._ground[frame].shape)[:, BALL]
        for leg, foot in enumerate(crowd.feet[0]):
            stands = int(foot["body"]) if foot["state"] else int(body[leg])
            self._frame_id[frame, leg] = stands
            self._frame_at[frame, leg] = self._scene.data.xpos[stands]
            self._frame_turn[frame, leg] = self._scene.data.xquat[stands]

    def _pose(self, crowd: Crowd, hinges: HingePose | None) -> tuple[Array, Array, Array, Array]:
        """Root, local rotations, and all joints (1, J, 3) and (1, J, 4) in the world."""
        skeleton = self._scene.motion.rig.skeleton
        root, rotations = crowd.roots[0].copy(), crowd.rotations[0].copy()
        if hinges is not None:
            at, turn = hinges.character.world_pose(self._scene.data, hinges.point_turns)
            above = skeleton.parents[1:]
            rotations[1:] = qa.mul(qa.conj(turn[above]), turn[1:])
            return root, rotations, at[None], turn[None]
        moves = None
        if self._scene.motion.translations.shape[0]:
            moves = crowd.block.moves[:1]
        elif crowd.settings.max_stretch > 1.0:
            moves = stretched_offsets(self._scene.motion.rig, crowd.feet[0]["stretch"])[None]
        return root, rotations, *skeleton.forward(rotations[None], root[None], moves)

    def recording(self, fps: float, *, even: bool) -> Recording:
        rig = self._scene.motion.rig
        feet = np.array(self._feet)
        legs = rig.legs
        has_toes = all(leg.toe >= 0 for leg in legs)
        names = ("hip", "knee", "ankle", "toe") if has_toes else ("hip", "knee", "ankle")
        chains = np.array([[getattr(leg, name) for name in names] for leg in legs])
        times = np.arange(len(self._roots)) / fps
        # The runtime may lift a heel before the clip does: then the ball carries the foot.
        on_ball = (feet["lifted"] > _HEEL_OFF) | (feet["landed"] != ON_HEEL)
        on_ball &= feet["state"] == GROUNDED
        self._phases = _on_ball(self._phases, on_ball)
        phases_at = partial(_phases_at, self._scene.motion, float(self._bodies[0]["rate"]))
        phase_at = _carried(phases_at, times, on_ball)
        run = Run(
            fps=fps,
            times=times,
            hips=self._joints[:, rig.hips],
            leg_rotations=self._rotations[:, chains],
            ankle=self._joints[:, chains[:, 2]],
            toe=self._joints[:, chains[:, 3]] if has_toes else self._sole[:, :, BALL],
            sole=self._sole,
            ground=self._ground,
            phase=self._phases,
            phase_at=phase_at if even else None,
            locked=feet["locked"].astype(bool) if self._ik else None,
            pin=np.where(feet["locked"] == 1, feet["pin"], -1),
            ground_positions=self._frame_at,
            ground_rotations=self._frame_turn,
            ground_ids=self._frame_id,
            joints=self._joints,
        )
        return Recording(
            fps=fps,
            times=times,
            roots=self._roots,
            rotations=self._rotations,
            bodies=np.array(self._bodies),
            feet=feet,
            phases=self._phases,
            run=run,
        )
