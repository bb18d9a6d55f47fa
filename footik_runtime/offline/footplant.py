"""FootPlant: the Kovar-style cleanup pass as it exists elsewhere, kept as a preset to compare with.

"Footskate Cleanup for Motion Capture Editing" (Kovar, Schreiner, Gleicher 2002), reduced: plants by
the ankle's speed and height over one ground, each held at the mean place of its ankle by two-bone
IK, eased over three frames. It never moves the root, knows no heel or toe, and its thresholds are
those of one body; `clean` alone scales them. The arrays may be in any unit and have any up.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from footik_runtime.clip import Clip
from footik_runtime.errors import FootIKError
from footik_runtime.math3d import quat_upright, rotate
from footik_runtime.offline.footplant_solve import hold
from footik_runtime.offline.stages import Bools, Cleaned, Contacts, Plant
from footik_runtime.rig import Leg, Rig, find_rig
from footik_runtime.skeleton import Skeleton

Array = NDArray[np.float64]
Interval = tuple[int, int]

_STAYS = 1.5  # times the thresholds, as long as a plant lasts
_GROUND_SHARE = 0.05  # of the frames lie lower than the ground
_FEWEST_FRAMES = 3  # in which anything is detected
_LEG = 0.85  # m: the leg that the thresholds in metres are for
_UP = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True, kw_only=True)
class FootPlantOptions:
    """Thresholds in the motion's own unit; these are in centimetres.

    Attributes:
        speed: below which an ankle may be planted, a second.
        height: over the ground below which it may.
        min_frames: of a plant.
        blend: frames on either side over which a correction fades.
        stretch: largest share added to a leg that cannot reach; 0 keeps all lengths.
    """

    speed: float = 8.0
    height: float = 4.0
    min_frames: int = 3
    blend: int = 3
    stretch: float = 0.02

    def __post_init__(self) -> None:
        for name in ("speed", "height", "min_frames", "blend", "stretch"):
            value = getattr(self, name)
            if not (np.isfinite(value) and value >= 0):
                raise FootIKError(f"FootPlant's {name} must be finite and 0 or more, not {value}.")

    def scaled(self, unit: float) -> FootPlantOptions:
        """The same thresholds for a motion whose lengths are `unit` times as large."""
        return replace(self, speed=self.speed * unit, height=self.height * unit)


@dataclass(frozen=True, kw_only=True, eq=False)
class LegJoints:
    """One leg of a tree: joint indices, and the axis a straight leg bends about.

    bend_axis: (3,) in the hip joint's frame: ankle - hip cross knee - hip of a bent leg.
    """

    hip: int
    knee: int
    ankle: int
    bend_axis: Array


@dataclass(frozen=True, kw_only=True, eq=False)
class FootReport:
    """What was done to one foot, in the motion's unit.

    Attributes:
        plants: first and last frame of each, both included.
        anchors: (plants, 3) where the ankle is held.
        largest_turn: of hip or knee in the world in one correction, rad.
        largest_move: of the ankle in one correction.
        residual_slide: largest move of the ankle from one frame to the next inside a plant.
    """

    plants: tuple[Interval, ...]
    anchors: Array
    largest_turn: float
    largest_move: float
    residual_slide: float


@dataclass(frozen=True, kw_only=True, eq=False)
class FootPlantResult:
    """Local translations (T, J, 3) and rotations (T, J, 4, wxyz) after the pass, and its report.

    ankles: (T, feet, 3) in the world, after.
    """

    local_positions: Array
    local_rotations: Array
    ankles: Array
    ground: float
    feet: tuple[FootReport, ...]


def ground_height(ankles: Array, up: Array) -> float:
    """Height of the ground under ankles (T, feet, 3): what 5 % of the frames' lower ankles reach.

    0 where there are no frames.
    """
    if len(ankles) == 0:
        return 0.0
    lowest = np.sort((ankles @ np.asarray(up, dtype=np.float64)).min(axis=1))
    return float(lowest[int(_GROUND_SHARE * (len(lowest) - 1))])


def detect(
    ankle: Array, ground: float, fps: float, up: Array, options: FootPlantOptions | None = None
) -> list[Interval]:
    """The plants of one ankle (T, 3): first and last frame of each, both included.

    A plant is entered below both thresholds and lasts while both are below 1.5 times as much.
    """
    options = options or FootPlantOptions()
    if len(ankle) < _FEWEST_FRAMES:
        return []
    velocity = np.gradient(ankle, axis=0) * fps  # central, one-sided at the ends
    speed = np.linalg.norm(velocity, axis=-1)
    height = ankle @ np.asarray(up, dtype=np.float64) - ground
    enters = (speed < options.speed) & (height < options.height)
    stays = (speed < _STAYS * options.speed) & (height < _STAYS * options.height)
    # A frame that only stays has the state of the last decisive one before it, and none without.
    last = np.maximum.accumulate(np.where(enters | ~stays, np.arange(len(ankle)), -1))
    planted = (last >= 0) & enters[last]
    edges = np.flatnonzero(np.diff(planted, prepend=False, append=False)).reshape(-1, 2)
    return [(int(a), int(b) - 1) for a, b in edges if b - a >= options.min_frames]


def weights(plants: Sequence[Interval], which: int, frames: int, blend: int) -> Array:
    """(frames,) of one plant's correction: 1 inside, fading over `blend` frames on either side.

    Frames of other plants of the foot have none.
    """
    start, stop = plants[which]
    frame = np.arange(frames)
    away = np.maximum(np.maximum(start - frame, frame - stop), 0)
    t = np.maximum(1.0 - away / (blend + 1.0), 0.0)
    weight = t * t * (3.0 - 2.0 * t)
    for i, (first, last) in enumerate(plants):
        if i != which:
            weight[first : last + 1] = 0.0
    return weight


def clean_frames(
    local_positions: Array,
    local_rotations: Array,
    parents: Sequence[int] | NDArray[np.int32],
    legs: Sequence[LegJoints],
    *,
    fps: float,
    up: Array = _UP,
    options: FootPlantOptions | None = None,
) -> FootPlantResult:
    """The pass on the frames of any tree, in its own unit and with its own up.

    Args:
        local_positions: (T, J, 3) relative to the parent; the root's in the world.
        local_rotations: (T, J, 4) likewise, wxyz.
        parents: (J,) parents before children, -1 for joint 0.
        legs: left before right; each foot is corrected on the others' result.
        fps: frames a second.
        up: (3,) unit.
        options: in the same unit of length.
    """
    options = options or FootPlantOptions()
    moves = np.array(local_positions, dtype=np.float64)
    turns = np.array(local_rotations, dtype=np.float64)
    tree = Skeleton(
        names=tuple(f"joint {j}" for j in range(len(parents))),
        parents=np.asarray(parents, dtype=np.int32),
        offsets=np.zeros((len(parents), 3)),
    )
    positions, rotations = tree.forward(turns, moves[:, 0], moves)
    ankles = [leg.ankle for leg in legs]
    ground = ground_height(positions[:, ankles], up)
    plants = [detect(positions[:, a], ground, fps, up, options) for a in ankles]
    reports = []
    for leg, found in zip(legs, plants, strict=True):
        path = np.array(_path(tree, leg), dtype=np.int64)
        knee_at = int(np.flatnonzero(path == leg.knee)[0])
        anchors = np.array([positions[a : b + 1, leg.ankle].mean(axis=0) for a, b in found])
        largest = np.zeros(2)
        for i in range(len(found)):
            hold(
                path, knee_at, tree.parents, moves, turns, positions, rotations,
                tuple(anchors[i]), weights(found, i, len(turns), options.blend),
                tuple(leg.bend_axis), 1.0 + options.stretch, largest,
            )  # fmt: skip
        reports.append(
            FootReport(
                plants=tuple(found),
                anchors=anchors.reshape(-1, 3),
                largest_turn=float(largest[0]),
                largest_move=float(largest[1]),
                residual_slide=_slide(positions[:, leg.ankle], found),
            )
        )
    return FootPlantResult(
        local_positions=moves,
        local_rotations=turns,
        ankles=positions[:, ankles],
        ground=ground,
        feet=tuple(reports),
    )


def _path(tree: Skeleton, leg: LegJoints) -> list[int]:
    """Joints from hip to ankle, with what lies between."""
    line = tree.chain(leg.ankle)
    if leg.hip not in line or leg.knee not in line:
        raise FootIKError(
            f"joints {leg.hip}, {leg.knee} and {leg.ankle} are not a leg: the ankle must descend "
            "from the knee, and the knee from the hip."
        )
    return line[line.index(leg.hip) :: -1]


def _slide(ankle: Array, plants: Sequence[Interval]) -> float:
    steps = np.linalg.norm(np.diff(ankle, axis=0), axis=-1)
    return max((float(steps[a:b].max()) for a, b in plants if b > a), default=0.0)


def clean(clip: Clip, rig: Rig | None = None, options: FootPlantOptions | None = None) -> Cleaned:
    """The pass on a clip: legs of planted feet turned, all else left as it is.

    Args:
        clip: any clip; its ground need not be at 0.
        rig: its legs, found by name or shape by default. Every leg is a foot.
        options: in metres, for this body. By default 8 cm/s and 4 cm for legs of 0.85 m, scaled
            to the rig's; give `stretch=0` where the format holds no translations.
    """
    rig = rig or find_rig(clip.skeleton)
    scale = float(rig.leg_lengths.mean()) / _LEG
    options = options or FootPlantOptions().scaled(0.01 * scale)
    offsets = clip.skeleton.offsets
    local = np.tile(offsets, (len(clip), 1, 1)) if clip.translations is None else clip.translations
    moves = local.copy()
    moves[:, 0] = clip.root_positions
    result = clean_frames(
        moves,
        clip.rotations,
        clip.skeleton.parents,
        [_leg_joints(leg, rig) for leg in rig.legs],
        fps=clip.fps,
        options=options,
    )
    translations = clip.translations
    if not np.array_equal(result.local_positions[:, 1:], moves[:, 1:]):
        translations = result.local_positions.copy()
        translations[:, 0] = local[:, 0]
    cleaned = replace(clip, rotations=result.local_rotations, translations=translations)
    contacts = _contacts(clip, rig, result)
    return Cleaned(
        clip=cleaned,
        rig=rig,
        contacts=contacts,
        plants=_plants(cleaned, rig, result),
        phases=contacts.phases(),
        root_moves=np.zeros((len(clip), 3)),
        report=_report(rig, result),
    )


def _leg_joints(leg: Leg, rig: Rig) -> LegJoints:
    """The leg with the bend axis of its rest pose, or one that takes the knee forward."""
    positions, rotations = rig.skeleton.rest_pose()
    hip, knee, ankle = positions[[leg.hip, leg.knee, leg.ankle]]
    normal = np.cross(ankle - hip, knee - hip)
    lengths = np.linalg.norm(ankle - hip) * np.linalg.norm(knee - hip)
    if np.linalg.norm(normal) < 1e-3 * lengths or lengths == 0.0:
        normal = np.cross(-_UP, rig.forward)
    turn = rotations[leg.hip] * [1.0, -1.0, -1.0, -1.0]
    return LegJoints(
        hip=leg.hip,
        knee=leg.knee,
        ankle=leg.ankle,
        bend_axis=np.array(rotate(tuple(turn), tuple(normal / np.linalg.norm(normal)))),
    )


def _contacts(clip: Clip, rig: Rig, result: FootPlantResult) -> Contacts:
    """Heel and toe down together: this detector knows the ankle only."""
    foot: Bools = np.zeros((len(clip), len(rig.legs)), dtype=bool)
    for i, report in enumerate(result.feet):
        for a, b in report.plants:
            foot[a : b + 1, i] = True
    down = np.repeat(foot[..., None], 2, axis=-1)
    under = result.ground - np.array([leg.sole.height for leg in rig.legs])
    return Contacts(
        fps=clip.fps,
        down=down,
        confidence=down.astype(np.float64),
        ground=np.broadcast_to(under[:, None], down.shape).copy(),
        belt=np.zeros(3),
    )


def _plants(clip: Clip, rig: Rig, result: FootPlantResult) -> tuple[Plant, ...]:
    _, rotations = clip.model_pose()
    plants = []
    for foot, (leg, report) in enumerate(zip(rig.legs, result.feet, strict=True)):
        for (start, last), anchor in zip(report.plants, report.anchors, strict=True):
            middle = tuple(rotations[(start + last) // 2, leg.ankle])
            ahead = rotate(middle, rotate(tuple(leg.sole.frame), (1.0, 0.0, 0.0)))
            turn = quat_upright(ahead, (0.0, 0.0, 1.0))
            along, under = np.array(rotate(turn, (1.0, 0.0, 0.0))), leg.sole.height * _UP
            plants.append(
                Plant(
                    foot=foot,
                    start=start,
                    flat=start,
                    roll=last + 1,
                    stop=last + 1,
                    heel=anchor - leg.sole.heel * along - under,
                    ball=anchor + leg.sole.ball * along - under,
                    turn=np.array(turn),
                    normal=_UP.copy(),
                    change=report.largest_move,
                )
            )
    return tuple(sorted(plants, key=lambda plant: (plant.start, plant.foot)))


def _report(rig: Rig, result: FootPlantResult) -> dict[str, object]:
    return {
        "preset": "footplant",
        "ground_height": result.ground,
        "feet": {
            leg.name: {
                "plants": [list(interval) for interval in report.plants],
                "largest_turn_deg": float(np.degrees(report.largest_turn)),
                "largest_move": report.largest_move,
                "residual_slide": report.residual_slide,
            }
            for leg, report in zip(rig.legs, result.feet, strict=True)
        },
    }
