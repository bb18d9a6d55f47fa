"""Motion: a clip made ready for the runtime, in place, with what each foot will do next.

`Motion.prepare` cuts a cycle, takes its travel out, and tables for every frame and foot the time
to the next plant and the footprint it will leave. `sample_pose` then is one cubic look-up.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from footik_runtime import quat_arrays
from footik_runtime.clip import Clip, cubic_weights
from footik_runtime.compiled import compiled
from footik_runtime.errors import FootIKError
from footik_runtime.feet.record import LOCKS
from footik_runtime.math3d import quat_unit, set4
from footik_runtime.offline.contacts import mend_seam, with_contacts
from footik_runtime.offline.loops import find_loop, put_in_place
from footik_runtime.phases import Phase, lock_curve, phase_curve, weight_curve
from footik_runtime.rig import Rig
from footik_runtime.sole import BALL, HEEL, all_sole_points

Array = NDArray[np.float64]

TIMING = np.dtype(
    [
        ("weight", "f8"),
        ("phase", "i4"),
        ("lock", "i4"),
        ("to_plant", "f8"),
        ("to_release", "f8"),
        ("swing_time", "f8"),
        ("print", "f8", 2),
        ("print_yaw", "f8"),
        ("middle", "f8", 2),
        ("middle_yaw", "f8"),
        ("to_middle", "f8"),
        ("pitch", "f8"),
        ("hip", "f8", 3),
        ("extension", "f8"),
        ("off_pitch", "f8"),
        ("off_hip", "f8", 3),
        ("off_extension", "f8"),
    ],
    align=True,
)
"""What one foot does in one frame, seen from the root.

weight: of the IK curve. phase: `Phase`. lock: of the clip's lock curve, -1 without. to_plant:
seconds to the next plant, or minus the time since the last one while in contact, so that it falls
at rate 1 and jumps at the release alone; inf for a foot that never plants, 0 for one that always
stands. to_release: seconds to the end of the present contact, 0 in swing, inf for a foot that
always stands. swing_time: duration of the swing before that plant, s, 0 for a foot without a swing.
print (2,) and print_yaw: where that plant's flat footprint lies under the ankle, m and rad, in the
frame the root has *at the plant*. middle, middle_yaw: the same in the frame the root has in the
middle of the contact, to_middle seconds after the plant. pitch: how far the sole's nose points up
at the plant, rad. hip (3,): the leg's hip joint then, in the same frame; extension: from there to
the ankle, m. off_*: the same three at the end of that contact, off_hip in the frame the root has
then.
"""


@dataclass(frozen=True, kw_only=True, eq=False)
class Motion:
    """One cycle of T frames in place, ready to be sampled at any time by compiled code.

    Attributes:
        rig: whose soles fit this clip.
        clip: the cycle; joint 0 in the root's frame (x forward, z up from the floor).
        velocity: (2,) of the root in its own frame, m/s.
        yaw_rate: of the root, rad/s.
        roots: (T + 2, 3) the clip's root positions, one frame of the loop more at either end.
        rotations: (T + 2, J, 4) likewise, signs continuous.
        translations: (T + 2, J, 3) likewise, or (0, J, 3) where the skeleton's offsets hold.
        timing: (T, legs) of `TIMING`.
        seam: how far the cycle's last pose was from its first before it was closed, m.
    """

    rig: Rig
    clip: Clip
    velocity: Array
    yaw_rate: float
    roots: Array
    rotations: Array
    translations: Array
    timing: NDArray[np.void]
    seam: float

    @property
    def speed(self) -> float:
        """Of the root, m/s."""
        return float(np.hypot(*self.velocity))

    @classmethod
    def prepare(cls, clip: Clip, rig: Rig) -> Motion:
        """Find contacts, cut the best cycle unless the clip is a loop, and table it.

        Weight and phase curves that the clip has are kept. A clip without any also gets its floor
        levelled and put at z = 0, and soles that fit it: the motion's `rig` has them.

        Raises:
            FootIKError: the clip has fewer than three frames or another skeleton than the rig, or
                one of its phase curves a value that is no `Phase`.
        """
        _require_skeleton(clip, rig)
        if len(clip) < 3:
            raise FootIKError(f"{clip.name}: {len(clip)} frames are too few; a motion needs 3.")
        clip, rig = with_contacts(clip, rig)
        if not clip.loop:
            first, last = find_loop(clip, rig)
            clip = mend_seam(clip.cut(first, last + 1), rig)
        placed = put_in_place(clip, rig)
        cycle = placed.clip
        pad = [len(cycle) - 2, *range(len(cycle)), 1]
        translations = np.zeros((0, len(rig.skeleton), 3))
        if cycle.translations is not None:
            translations = cycle.translations[pad]
        return cls(
            rig=rig,
            clip=cycle,
            velocity=placed.velocity,
            yaw_rate=placed.yaw_rate,
            roots=np.ascontiguousarray(cycle.root_positions[pad]),
            rotations=_sign_continuous(cycle.rotations[pad]),
            translations=np.ascontiguousarray(translations),
            timing=_timing(cycle, rig, placed.velocity, placed.yaw_rate),
            seam=placed.seam,
        )


def _require_skeleton(clip: Clip, rig: Rig) -> None:
    ours, theirs = clip.skeleton, rig.skeleton
    if len(ours) != len(theirs):
        raise FootIKError(
            f"{clip.name}: the rig was made for another skeleton, of {len(theirs)} joints, "
            f"not {len(ours)}."
        )
    for j, (a, b) in enumerate(zip(ours.names, theirs.names, strict=True)):
        if a != b or ours.parents[j] != theirs.parents[j]:
            raise FootIKError(
                f"{clip.name}: the rig was made for another skeleton: joint {j} is {a!r} with "
                f"parent {ours.parents[j]} in the clip, {b!r} with parent {theirs.parents[j]} in "
                "the rig."
            )


def _sign_continuous(rotations: Array) -> Array:
    turned = np.einsum("tjk,tjk->tj", rotations[1:], rotations[:-1]) < 0.0
    out = rotations.copy()
    out[1:] *= np.cumprod(np.where(turned, -1.0, 1.0), axis=0)[..., None]
    return out


def _timing(clip: Clip, rig: Rig, velocity: Array, yaw_rate: float) -> NDArray[np.void]:
    """(T, legs) `TIMING` of a cycle in place; its last frame repeats the first."""
    positions, rotations = clip.model_pose()
    points = all_sole_points(rig, positions, rotations)
    frames = len(clip) - 1
    table = np.zeros((len(clip), len(rig.legs)), dtype=TIMING)
    for i, leg in enumerate(rig.legs):
        row = table[:, i]
        row["weight"] = clip.curves[weight_curve(leg.name)]
        row["phase"] = clip.curves[phase_curve(leg.name)].round()
        row["lock"] = _locks(clip, leg.name)
        contact = row["phase"][:frames] != Phase.SWING
        row["to_plant"], row["swing_time"] = np.inf, 0.0
        row["hip"] = positions[:, leg.hip]
        toward = quat_arrays.mul(rotations[:frames, leg.ankle], leg.sole.frame)
        ahead = quat_arrays.rotate(toward, np.array([1.0, 0.0, 0.0]))
        for start, length, swing in _contacts(contact):
            during = (start + np.arange(length)) % frames
            # A foot that always stands plants again in every frame: it moves with the root.
            age = np.arange(length) / clip.fps if swing else np.zeros(length)
            print_xy, yaw = _footprint(
                leg.sole, row["phase"][during], points[during, i], ahead[during], age,
                velocity, yaw_rate,
            )  # fmt: skip
            before = (start - np.arange(swing, 0, -1)) % frames
            row["to_plant"][during] = 0.0 - age
            row["to_release"][during] = length / clip.fps - age if swing else np.inf
            row["to_plant"][before] = np.arange(swing, 0, -1) / clip.fps
            both = np.concatenate([before, during])
            row["swing_time"][both] = swing / clip.fps
            row["print"][both] = print_xy
            row["print_yaw"][both] = yaw
            half = 0.5 * length / clip.fps if swing else 0.0
            middle, turned = _seen_later(complex(*print_xy), half, velocity, yaw_rate)
            row["middle"][both] = middle.real, middle.imag
            row["middle_yaw"][both], row["to_middle"][both] = yaw - turned, half
            for name, at in (("", start), ("off_", (start + length - 1) % frames)):
                hip, ankle = positions[at, leg.hip], positions[at, leg.ankle]
                row[name + "pitch"][both] = np.arcsin(np.clip(ahead[at, 2], -1.0, 1.0))
                row[name + "hip"][both] = hip
                row[name + "extension"][both] = np.linalg.norm(ankle - hip)
        row[frames] = row[0]
    return table


def _locks(clip: Clip, leg: str) -> NDArray[np.int64]:
    """(T,) the values of a leg's lock curve, -1 without one. Raises FootIKError for any other."""
    curve = clip.curves.get(lock_curve(leg))
    if curve is None:
        return np.full(len(clip), -1)
    locks = np.rint(curve).astype(int)
    wrong = np.flatnonzero((locks < 0) | (locks >= len(LOCKS)))
    if len(wrong):
        raise FootIKError(
            f"{clip.name}: curve {lock_curve(leg)} is {curve[wrong[0]]:g} in frame {wrong[0]}: "
            f"locks are 0 to {len(LOCKS) - 1} ({', '.join(LOCKS)})."
        )
    return locks


def _contacts(contact: NDArray[np.bool_]) -> list[tuple[int, int, int]]:
    """(first frame, frames, frames of swing before it) of each contact of a cycle."""
    frames = len(contact)
    if contact.all():
        return [(0, frames, 0)]
    starts = np.flatnonzero(contact & ~np.roll(contact, 1))
    stops = np.flatnonzero(~contact & np.roll(contact, 1))
    out = []
    for start in starts:
        length = int(min((stop - start) % frames for stop in stops))
        swing = int(min((start - stop) % frames for stop in stops))
        out.append((int(start), length, swing))
    return out


def _travel(seconds, velocity, yaw_rate):
    """Where a root that keeps its velocity comes to, seen from its start: x + iy; any shape."""
    if abs(yaw_rate) < 1e-9:
        return complex(*velocity) * seconds
    return complex(*velocity) * (np.exp(1j * yaw_rate * seconds) - 1) / (1j * yaw_rate)


def _seen_later(place: complex, seconds: float, velocity, yaw_rate) -> tuple[complex, float]:
    """A place in the root's frame as the root sees it later, and how far it has turned then."""
    turned = yaw_rate * seconds
    moved = place - _travel(seconds, velocity, yaw_rate)
    return complex(moved * np.exp(-1j * turned)), turned


def _footprint(sole, phases, points, ahead, age, velocity, yaw_rate) -> tuple[Array, float]:
    """Where the flat foot of one contact lies: (2,) under the ankle, and its yaw.

    Each frame's pinned point says where the print would be; the root carries it away at constant
    velocity, which is taken out; the mean over the contact is the place that moves feet least.
    """
    turn = yaw_rate * age
    moved = _travel(age, velocity, yaw_rate)
    direction = (ahead[:, 0] + 1j * ahead[:, 1]) * np.exp(1j * turn)
    weight = np.where(phases == Phase.FLAT, 1.0, 0.02)
    direction = np.sum(weight * direction)
    direction = direction / abs(direction) if abs(direction) > 1e-9 else 1.0 + 0.0j
    flat = (points[..., 0] + 1j * points[..., 1]) * np.exp(1j * turn)[:, None] + moved[:, None]
    by_heel = flat[:, HEEL] + direction * sole.heel
    by_ball = flat[:, BALL] - direction * sole.ball
    place = np.where(phases == Phase.HEEL, by_heel, by_ball)
    place = np.where(phases == Phase.FLAT, 0.5 * (by_heel + by_ball), place)
    mean = np.sum(weight * place) / weight.sum()
    return np.array([mean.real, mean.imag]), float(np.angle(direction))


@compiled
def sample_pose(roots, rotations, translations, fps, time, root, turns, moves):
    """Write the pose of a cycle at a time into root (3,), turns (J, 4) and moves (J, 3).

    Arrays are those of `Motion`; `moves` is left alone where it has no translations.
    Returns the frame at or before the time, and how far past it the time is, in frames.
    """
    last = rotations.shape[0] - 3
    x = time * fps
    x -= np.floor(x / last) * last
    i = min(int(x), last - 1)
    u = x - i
    a, b, c, d = cubic_weights(u)
    for k in range(3):
        root[k] = a * roots[i, k] + b * roots[i + 1, k] + c * roots[i + 2, k] + d * roots[i + 3, k]
    for j in range(rotations.shape[1]):
        p, q, r, s = rotations[i, j], rotations[i + 1, j], rotations[i + 2, j], rotations[i + 3, j]
        mixed = (
            a * p[0] + b * q[0] + c * r[0] + d * s[0],
            a * p[1] + b * q[1] + c * r[1] + d * s[1],
            a * p[2] + b * q[2] + c * r[2] + d * s[2],
            a * p[3] + b * q[3] + c * r[3] + d * s[3],
        )
        set4(turns[j], quat_unit(mixed))
    if translations.shape[0] == 0:
        return i, u
    for j in range(1, translations.shape[1]):
        p, q = translations[i, j], translations[i + 1, j]
        r, s = translations[i + 2, j], translations[i + 3, j]
        for k in range(3):
            moves[j, k] = a * p[k] + b * q[k] + c * r[k] + d * s[k]
    return i, u
