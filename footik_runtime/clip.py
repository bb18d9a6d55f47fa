"""Clip: frames of a skeleton at a fixed rate, with named curves; sampled by cubic interpolation."""

from __future__ import annotations

import cmath
import math
from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from footik_runtime.compiled import compiled
from footik_runtime.errors import FootIKError
from footik_runtime.math3d import get4, quat_heading, quat_mul, quat_yaw
from footik_runtime.skeleton import Skeleton

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, eq=False)
class Pose:
    """One pose: local joint rotations and the root's place.

    Attributes:
        root_position: (3,) of joint 0, m.
        rotations: (J, 4) local, wxyz.
        translations: (J, 3) local, m, or None where they are the skeleton's offsets.
        curves: value of each named curve.
    """

    root_position: Array
    rotations: Array
    translations: Array | None = None
    curves: dict[str, float] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True, eq=False)
class Clip:
    """T frames at `fps`; frame i is at i / fps seconds, so it lasts (T - 1) / fps seconds.

    Attributes:
        skeleton: the joints that move, J of them.
        fps: frames a second.
        root_positions: (T, 3) of joint 0, m, z up.
        rotations: (T, J, 4) local, wxyz, unit, made continuous in sign along time.
        translations: (T, J, 3) local, m, or None where they are the skeleton's offsets.
        curves: name -> (T,) values, such as IK weights.
        loop: the last frame is the first one again, a cycle later and a stride further on.
        name: what to call it in messages.
        extras: what a file format wants to find again when it writes the clip back.
    """

    skeleton: Skeleton
    fps: float
    root_positions: Array
    rotations: Array
    translations: Array | None = None
    curves: dict[str, Array] = field(default_factory=dict)
    loop: bool = False
    name: str = "clip"
    extras: dict[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        set_field = object.__setattr__
        joints = len(self.skeleton)
        frames = len(self.rotations)
        if not (np.isfinite(self.fps) and self.fps > 0):
            raise FootIKError(f"{self.name}: fps must be positive and finite, not {self.fps}.")
        if frames < 1:
            raise FootIKError(f"{self.name}: a clip needs at least one frame.")
        arrays = {"root_positions": (frames, 3), "rotations": (frames, joints, 4)}
        if self.translations is not None:
            arrays["translations"] = (frames, joints, 3)
        for attribute, shape in arrays.items():
            value = np.ascontiguousarray(getattr(self, attribute), dtype=np.float64)
            if value.shape != shape:
                raise FootIKError(f"{self.name}: {attribute} must be {shape}, not {value.shape}.")
            self._require_finite(attribute, value)
            set_field(self, attribute, value)
        self._require_curves(self.curves)
        set_field(self, "rotations", _continuous(self.rotations, self.name))

    def _require_curves(self, curves: dict[str, Array]) -> None:
        for curve, values in curves.items():
            if np.shape(values) != (len(self),):
                raise FootIKError(
                    f"{self.name}: curve {curve!r} must have {len(self)} values, "
                    f"not shape {np.shape(values)}."
                )
            self._require_finite(f"curve {curve!r}", np.asarray(values, dtype=np.float64))

    def _require_finite(self, what: str, value: Array) -> None:
        bad = np.argwhere(~np.isfinite(value))
        if len(bad):
            frame = bad[0][0]
            joint = f", joint {self.skeleton.names[bad[0][1]]!r}" if value.ndim == 3 else ""
            raise FootIKError(
                f"{self.name}: {what} is not finite at frame {frame}{joint} "
                f"({len(np.unique(bad[:, 0]))} of {len(value)} frames are bad)."
            )

    def __len__(self) -> int:
        return len(self.rotations)

    @property
    def duration(self) -> float:
        """Seconds from the first frame to the last."""
        return (len(self) - 1) / self.fps

    @property
    def times(self) -> Array:
        """(T,) seconds of each frame."""
        return np.arange(len(self)) / self.fps

    def with_curves(self, /, **curves: Array) -> Clip:
        """The same clip with these curves added or replaced."""
        self._require_curves(curves)
        return self._with(curves={**self.curves, **curves})

    def with_extras(self, /, **extras: Any) -> Clip:
        """The same clip with these extras added or replaced."""
        return self._with(extras={**self.extras, **extras})

    def moved(self, root_positions: Array, rotations: Array | None = None) -> Clip:
        """The same clip with another motion (T, 3) and (T, J, 4), which is not checked.

        It must be finite, unit and continuous in sign, as what is made from a clip's own is.
        """
        kept = self.rotations if rotations is None else rotations
        return self._with(root_positions=root_positions, rotations=kept)

    def only(self, joints: Sequence[int]) -> Clip:
        """The motion of some joints alone: the root, and none without its parent."""
        moves = self.translations
        return self._with(
            skeleton=self.skeleton.only(joints),
            rotations=np.ascontiguousarray(self.rotations[:, joints]),
            translations=None if moves is None else np.ascontiguousarray(moves[:, joints]),
        )

    def _with(self, /, **fields: Any) -> Clip:
        """`replace` for what needs no checking: that takes longest."""
        changed = copy(self)
        for name, value in fields.items():
            object.__setattr__(changed, name, value)
        return changed

    def cut(self, start: int, stop: int) -> Clip:
        """Frames start to stop - 1 as a clip of their own."""
        if not 0 <= start < stop <= len(self):
            raise FootIKError(
                f"{self.name}: cannot cut frames {start}:{stop} from a clip of {len(self)} frames."
            )
        return replace(
            self,
            root_positions=self.root_positions[start:stop],
            rotations=self.rotations[start:stop],
            translations=None if self.translations is None else self.translations[start:stop],
            curves={name: np.asarray(v)[start:stop] for name, v in self.curves.items()},
            loop=False,
        )

    def stride(self) -> tuple[float, Array]:
        """What one cycle of a loop adds to the root: yaw (rad) and displacement (3,), m.

        The displacement holds at the root's first heading, about the vertical through the origin:
        a point p of one cycle is yaw-turned p + displacement in the next.
        """
        first, last = self.rotations[0, 0], self.rotations[-1, 0]
        yaw = _heading_change(first, last)
        turned = _turned(self.root_positions[0], yaw)
        return yaw, self.root_positions[-1] - turned

    def sample(self, time: float) -> Pose:
        """The pose at a time in seconds, by cubic interpolation.

        A looping clip goes on for ever in both directions, its root moving on by one stride and
        turning by one turn a cycle; any other clip holds its first and last frame.
        """
        if not math.isfinite(time):
            raise FootIKError(f"{self.name}: cannot sample at time {time}.")
        last = len(self) - 1
        x = time * self.fps if self.loop else min(max(time * self.fps, 0.0), float(last))
        first = math.floor(x) if last else 0
        u = x - first if last else 0.0
        weights = np.array(cubic_weights(u))
        frames = [first - 1, first, first + 1, first + 2]
        cycles = np.zeros(4, dtype=int)
        if self.loop and last:
            cycles = np.floor_divide(frames, last)
            frames = list(np.asarray(frames) - cycles * last)
        else:
            frames = [min(max(f, 0), last) for f in frames]
        roots = [self._root(f, int(c)) for f, c in zip(frames, cycles, strict=True)]
        rotations = _blend_rotations(self.rotations[frames], weights)
        rotations[0] = _blend_rotations(np.array([[turn] for _, turn in roots]), weights)[0]
        moved = self.translations
        curves = {
            n: float((1 - u) * v[frames[1]] + u * v[frames[2]]) for n, v in self.curves.items()
        }
        return Pose(
            root_position=weights @ np.array([position for position, _ in roots]),
            rotations=rotations,
            translations=None if moved is None else np.tensordot(weights, moved[frames], 1),
            curves=curves,
        )

    def _root(self, frame: int, cycle: int) -> tuple[Array, Array]:
        """Position and rotation of the root in a frame of the cycle-th repetition."""
        position, rotation = self.root_positions[frame], self.rotations[frame, 0]
        if cycle == 0:
            return position, rotation
        yaw, step = self.stride()
        # n times the same turn and step, summed in closed form on the complex plane.
        turn = cmath.exp(1j * yaw)
        flat = complex(step[0], step[1])
        gone = flat * cycle if abs(turn - 1) < 1e-9 else flat * (1 - turn**cycle) / (1 - turn)
        moved = _turned(position, yaw * cycle) + np.array([gone.real, gone.imag, step[2] * cycle])
        return moved, np.array(quat_mul(quat_yaw(yaw * cycle), get4(rotation)))

    def model_pose(self) -> tuple[Array, Array]:
        """Positions (T, J, 3) and rotations (T, J, 4) of all joints in the clip's own frame."""
        return self.skeleton.forward(self.rotations, self.root_positions, self.translations)


def _continuous(rotations: Array, name: str) -> Array:
    """Unit quaternions whose sign never jumps between frames, so that components interpolate."""
    with np.errstate(over="ignore"):
        lengths = np.linalg.norm(rotations, axis=-1, keepdims=True)
    wrong = (lengths < 1e-6) | np.isinf(lengths)
    if wrong.any():
        frame, joint = np.argwhere(wrong[..., 0])[0]
        what = "zero" if lengths[frame, joint, 0] < 1e-6 else "infinite"
        raise FootIKError(f"{name}: rotation of joint {joint} at frame {frame} has {what} length.")
    # Leave what is unit already to the last bit: reading and writing again must not drift.
    unit = np.where(np.abs(lengths - 1.0) < 1e-12, rotations, rotations / lengths)
    turned = np.einsum("tjk,tjk->tj", unit[1:], unit[:-1]) < 0.0
    flips = np.cumprod(np.where(turned, -1.0, 1.0), axis=0)
    unit[1:] *= flips[..., None]
    return np.ascontiguousarray(unit)


def _heading_change(a: Array, b: Array) -> float:
    """Yaw in radians that turns rotation a's heading to b's."""
    return float(quat_heading(quat_mul(get4(b), (a[0], -a[1], -a[2], -a[3]))))


def _turned(v: Array, yaw: float) -> Array:
    """v (3,) turned about the vertical."""
    c, s = math.cos(yaw), math.sin(yaw)
    return np.array([c * v[0] - s * v[1], s * v[0] + c * v[1], v[2]])


def _blend_rotations(rotations: Array, weights: Array) -> Array:
    """(4, J, 4) samples to (J, 4), by weights (4,), made unit; signs are aligned first."""
    signs = np.where(np.einsum("sjk,jk->sj", rotations, rotations[1]) < 0.0, -1.0, 1.0)
    mixed = np.einsum("s,sj,sjk->jk", weights, signs, rotations)
    return mixed / np.linalg.norm(mixed, axis=-1, keepdims=True)


@compiled
def cubic_weights(u):
    """Catmull-Rom weights of the samples at -1, 0, 1, 2 for u in [0, 1]; exact at both ends."""
    return (
        0.5 * u * (-1.0 + u * (2.0 - u)),
        1.0 + 0.5 * u * u * (-5.0 + 3.0 * u),
        0.5 * u * (1.0 + u * (4.0 - 3.0 * u)),
        0.5 * u * u * (u - 1.0),
    )


def blend(a: Clip, b: Clip, weight: float) -> Clip:
    """The clip between two, `weight` of the way from a to b, matched by how far each has gone.

    Durations, root paths, rotations and the curves both have are blended; walks at two speeds, cut
    at the same phase, give a walk between. Raises FootIKError for different skeletons.
    """
    if a.skeleton.names != b.skeleton.names:
        raise FootIKError(f"cannot blend {a.name!r} with {b.name!r}: their joints differ.")
    if not 0.0 <= weight <= 1.0:
        raise FootIKError(f"a blend weight must be in [0, 1], not {weight}.")
    duration = (1.0 - weight) * a.duration + weight * b.duration
    fps = max(a.fps, b.fps)
    frames = max(2, round(duration * fps) + 1)
    poses = [
        (a.sample(s * a.duration), b.sample(s * b.duration)) for s in np.linspace(0, 1, frames)
    ]
    mix = np.array([1.0 - weight, weight])
    moved = a.translations is not None or b.translations is not None
    offsets = a.skeleton.offsets
    return replace(
        a,
        fps=(frames - 1) / duration if duration > 0 else fps,
        root_positions=np.array([mix @ [p.root_position, q.root_position] for p, q in poses]),
        rotations=np.array([_mix_rotations(p.rotations, q.rotations, mix) for p, q in poses]),
        translations=np.array([_mix_translations(p, q, mix, offsets) for p, q in poses])
        if moved
        else None,
        curves={
            n: np.array([mix @ [p.curves[n], q.curves[n]] for p, q in poses])
            for n in a.curves.keys() & b.curves.keys()
        },
        loop=a.loop and b.loop,
        name=f"{a.name}+{b.name}",
        extras={},
    )


def _mix_rotations(p: Array, q: Array, mix: Array) -> Array:
    sign = np.where(np.sum(p * q, axis=-1, keepdims=True) < 0.0, -1.0, 1.0)
    mixed = mix[0] * p + mix[1] * sign * q
    return mixed / np.linalg.norm(mixed, axis=-1, keepdims=True)


def _mix_translations(p: Pose, q: Pose, mix: Array, offsets: Array) -> Array:
    both = [offsets if pose.translations is None else pose.translations for pose in (p, q)]
    return np.tensordot(mix, np.array(both), 1)
