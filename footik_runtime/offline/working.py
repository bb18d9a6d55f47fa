"""Working: the clip as the offline rooms see it: level, travelling, padded where it loops."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from footik_runtime import quat_arrays
from footik_runtime.clip import Clip
from footik_runtime.errors import FootIKError
from footik_runtime.math3d import quat_between, quat_heading, quat_upright, rotate
from footik_runtime.offline import detect
from footik_runtime.offline.filters import contact_spans, span_medians
from footik_runtime.offline.stages import Bools, CleanSettings, Contacts, Ground, Ints, Working
from footik_runtime.phases import phase_curve, weight_curve
from footik_runtime.rig import Leg, Rig, Sole, find_rig
from footik_runtime.sole import BALL, HEEL, all_sole_points

Array = NDArray[np.float64]
_T = TypeVar("_T", bound=np.generic)

# Of a body whose legs are 0.85 m long; lengths and speeds scale with the leg.
_LEG = 0.85
_STILL = 0.25  # m/s, of an ankle whose foot stands flat
_ONE_FLOOR = 0.06  # m: feet that stand farther apart in height stand on different floors
_UNEVEN = 0.03  # m: a floor less even than this is no tilted plane
_MOST_TILT = math.radians(4.0)
_LEAST_TILT = math.radians(0.05)
_RIDGE = 0.15  # m: spread of the plants that says nothing about tilt
_FEWEST_FLAT = 3  # frames that tell a sole
_INCLINED = math.tan(math.radians(0.2))  # of a belt; a lesser incline is none
_PADDING = 1.5  # s of the neighbouring cycles
_SHORTEST_LOOP = 0.4  # s
_SAME_TURN, _SAME_PLACE = math.radians(0.5), 0.001  # rad, m: a pose that has returned
_OFF_WEIGHT = 0.01  # by which a weight curve may leave 0 to 1, as thinned keys do
_BESIDE = 0.5  # of a sole's step: how far that over a loop's seam may be from those beside it
_UP = np.array([0.0, 0.0, 1.0])
_IDENTITY = np.array([1.0, 0.0, 0.0, 0.0])


def working(
    clip: Clip,
    rig: Rig | None = None,
    *,
    settings: CleanSettings | None = None,
    ground: Ground | None = None,
) -> Working:
    """The clip as cleanup sees it: off its belt, level, on the floor z = 0, soles fitted, padded.

    A clip whose curves tell of every leg's contact keeps its floor, and with a phase for every leg
    its soles too. With a given `ground` it keeps them as well: its height is known.
    Raises FootIKError for a rig of another skeleton, and where no legs are found.
    """
    settings = CleanSettings() if settings is None else settings
    rig = find_rig(clip.skeleton) if rig is None else rig
    _require_same_skeleton(clip, rig)
    scale = float(rig.leg_lengths.mean()) / _LEG
    notes: list[str] = []
    frames = len(clip)
    clip, pad, closed = _padded(clip, rig, scale, notes)
    clip, rig, joints = _legs_only(clip, rig)
    back, raw, belt, contacts = _IDENTITY, clip.root_positions, np.zeros(3), None
    positions, rotations = clip.model_pose()
    if frames >= 3:
        soles = all_sole_points(rig, positions, rotations)
        contacts = detect.contacts(
            soles[:, :, :2], clip.fps, scale=scale, settings=settings.contact
        )
        if contacts.belt.any():
            belt = _belt_speed(soles, contacts, clip.fps, notes)
            off = -belt * (clip.times[:, None] - pad / clip.fps)
            clip, soles = clip.moved(clip.root_positions + off), soles + off[:, None, None]
            positions = positions + off[:, None]
        phased, weighted = (False, False) if settings.redetect else _told(clip, rig, notes)
        if ground is not None:
            phased = weighted = True  # its floor is known, and whether it is level
        if not (phased or weighted):
            upright = _upright(soles, contacts, scale, notes)
            back, raw = quat_arrays.conj(upright), quat_arrays.rotate(upright, raw)
            if upright is not _IDENTITY:
                clip = _turned_clip(clip, upright)
                positions, rotations = clip.model_pose()
        if not phased:
            rig, floor = _fitted(rig, positions, rotations, contacts, scale, clip.fps)
            if not weighted:
                clip = clip.moved(clip.root_positions - floor * _UP)
                positions = positions - floor * _UP
    return Working(
        clip=clip,
        rig=rig,
        joints=joints,
        positions=positions,
        rotations=rotations,
        soles=all_sole_points(rig, positions, rotations),
        scale=scale,
        back=back,
        shift=clip.root_positions - raw,
        belt=belt,
        pad=pad,
        frames=frames,
        closed=closed,
        contacts=contacts,
        notes=tuple(notes),
    )


def fitted_rig(rig: Rig, work: Working) -> Rig:
    """The clip's rig with the soles that were fitted in the working clip."""
    legs = list(zip(rig.legs, work.rig.legs, strict=True))
    if all(leg.sole is worked.sole for leg, worked in legs):
        return rig
    return replace(rig, legs=tuple(replace(leg, sole=worked.sole) for leg, worked in legs))


def as_worked(clip: Clip, work: Working, *, level: bool = False) -> Clip:
    """The whole clip as cleanup saw its legs: level, off its belt, on its floor.

    level: the clip's tilt is out already.
    """
    shift = unpad(work, work.shift)
    if level or work.back[0] == 1.0:
        return clip.moved(clip.root_positions + shift) if shift.any() else clip
    turned = _turned_clip(clip, quat_arrays.conj(work.back))
    return turned.moved(turned.root_positions + shift)


def unpad(work: Working, values: NDArray[_T]) -> NDArray[_T]:
    """The rows of `values` (N, ...) that are the clip's own frames."""
    return values[work.pad : work.pad + work.frames]


def _legs_only(clip: Clip, rig: Rig) -> tuple[Clip, Rig, Ints]:
    """Clip and rig with nothing but what carries feet, and its joints (K,): the rest only costs."""
    skeleton = clip.skeleton
    ends = [leg.toe if leg.toe >= 0 else leg.ankle for leg in rig.legs]
    joints = sorted({j for end in (rig.hips, *ends) for j in skeleton.chain(end)})
    place = {joint: i for i, joint in enumerate(joints)} | {-1: -1}
    parts = ("hip", "knee", "ankle", "toe")
    legs = tuple(replace(leg, **{p: place[getattr(leg, p)] for p in parts}) for leg in rig.legs)
    alone = clip.only(joints)
    rig = replace(rig, skeleton=alone.skeleton, hips=place[rig.hips], legs=legs)
    return alone, rig, np.array(joints, dtype=np.int64)


def _turned_clip(clip: Clip, turn: Array) -> Clip:
    """All of it turned by (4,) about the origin."""
    rotations = clip.rotations.copy()
    rotations[:, 0] = quat_arrays.mul(turn, rotations[:, 0])
    return clip.moved(quat_arrays.rotate(turn, clip.root_positions), rotations)


def _require_same_skeleton(clip: Clip, rig: Rig) -> None:
    if clip.skeleton.names != rig.skeleton.names:
        raise FootIKError(
            f"{clip.name}: the rig is of another skeleton ({len(rig.skeleton)} joints from "
            f"{rig.skeleton.names[0]!r}, the clip {len(clip.skeleton)} from "
            f"{clip.skeleton.names[0]!r})."
        )


def _told(clip: Clip, rig: Rig, notes: list[str]) -> tuple[bool, bool]:
    """Whether curves give the phase of every leg, and whether at least every leg's contact."""
    for leg in rig.legs:
        name = weight_curve(leg.name)
        values = np.asarray(clip.curves.get(name, 0.0))
        if values.min() < -_OFF_WEIGHT or values.max() > 1.0 + _OFF_WEIGHT:
            notes.append(
                f"curve {name!r} goes from {values.min():g} to {values.max():g}; a weight is of 0 "
                "to 1, and in contact from 0.5 on"
            )
    phased = [phase_curve(leg.name) in clip.curves for leg in rig.legs]
    weighted = [weight_curve(leg.name) in clip.curves for leg in rig.legs]
    return all(phased), all(p or w for p, w in zip(phased, weighted, strict=True))


def _belt_speed(soles: Array, contacts: Contacts, fps: float, notes: list[str]) -> Array:
    """(3,) m/s: the median velocity of what is down, which is exact where feet stand still.

    It goes up or down where every contact does: on an inclined belt.
    """
    down = np.asarray(contacts.down[1:] & contacts.down[:-1])
    steps = np.diff(soles[:, :, :2], axis=0) * fps
    belt = np.median(steps[down], axis=0) if down.any() else contacts.belt.copy()
    points = down.reshape(len(down), -1)
    climbs = span_medians(steps[..., 2].reshape(points.shape), contact_spans(points))
    least = _INCLINED * float(np.linalg.norm(belt[:2]))
    if not len(climbs) or abs(np.mean(climbs)) < max(3.0 * float(np.std(climbs)), least):
        belt[2] = 0.0
    notes.append(f"the feet stand on a belt: {np.linalg.norm(belt):.2f} m/s against the root")
    return belt


def _upright(soles: Array, contacts: Contacts, scale: float, notes: list[str]) -> Array:
    """(4,) what takes the floor's tilt out, where the feet stood on one nearly level plane.

    One point a plant: a long stand weighs as much as a step.
    """
    places = _stood(soles[:, :, BALL], np.asarray(contacts.down.all(axis=-1)))
    normal = _plane_normal(places, scale)
    tilt = math.acos(min(float(normal[2]), 1.0))
    if tilt < _LEAST_TILT:
        return _IDENTITY
    notes.append(f"the floor's tilt of {math.degrees(tilt):.1f} degrees is taken out")
    return np.array(quat_between(tuple(normal), (0.0, 0.0, 1.0)))


def _stood(points: Array, down: Bools) -> Array:
    """(K, 3) where points (T, F, 3) usually were in each time that they were `down` (T, F)."""
    spans = contact_spans(down)
    return np.stack([span_medians(points[..., axis], spans) for axis in range(3)], axis=-1)


def _plane_normal(points: Array, scale: float) -> Array:
    """Normal of the nearly level plane through points (K, 3), or up where they make none."""
    if len(points) < 3:
        return _UP
    centred = points - points.mean(axis=0)
    # A walk says little about the tilt across its way: a ridge keeps that part small.
    ridge = len(points) * (_RIDGE * scale) ** 2
    flat = centred[:, :2]
    slope = np.linalg.solve(flat.T @ flat + ridge * np.eye(2), flat.T @ centred[:, 2])
    uneven = float((centred[:, 2] - flat @ slope).std())
    if math.atan(np.linalg.norm(slope)) > _MOST_TILT or uneven > _UNEVEN * scale:
        return _UP
    normal = np.array([-slope[0], -slope[1], 1.0])
    return normal / np.linalg.norm(normal)


def _fitted(
    rig: Rig, positions: Array, rotations: Array, contacts: Contacts, scale: float, fps: float
) -> tuple[Rig, float]:
    """The rig with each sole flat where its foot stood flat and level, and the floor's height.

    A rest pose seldom says how the foot lies on the ground; its stance in the clip does. On steep
    ground it does not: there the soles stay. A foot that never stands keeps its own.
    """
    both = np.asarray(contacts.down.all(axis=-1))
    ankles = positions[:, [leg.ankle for leg in rig.legs]]
    speed = np.linalg.norm(np.gradient(ankles, axis=0), axis=-1) * fps
    flat = both & (speed < _STILL * scale)
    # The slower half: in the other the heel may be on its way up already.
    usual = [
        np.median(speed[flat[:, i], i]) if flat[:, i].any() else 0.0 for i in range(len(flat[0]))
    ]
    flat &= speed <= np.array(usual)
    floors = np.full(len(rig.legs), np.inf)
    for i, leg in enumerate(rig.legs):
        if flat[:, i].sum() >= _FEWEST_FLAT:
            floors[i] = float(np.median(ankles[flat[:, i], i, 2])) - leg.sole.height
    lowest = float(floors.min())
    if lowest == np.inf:
        return rig, float(all_sole_points(rig, positions, rotations)[..., 2].min())
    stands = floors < lowest + _ONE_FLOOR * scale
    floor = float(floors[stands].mean())
    if _on_steep_ground(all_sole_points(rig, positions, rotations), both):
        return rig, floor
    legs = tuple(
        replace(leg, sole=_fitted_sole(leg, rotations[flat[:, i]])) if stands[i] else leg
        for i, leg in enumerate(rig.legs)
    )
    return replace(rig, legs=legs), floor


def _on_steep_ground(soles: Array, flat: Bools) -> bool:
    """Whether plants climb as a slope does to which the soles lie more than to the level."""
    middle = 0.5 * (soles[:, :, HEEL] + soles[:, :, BALL])
    places = _stood(middle, flat)
    along = soles[:, :, BALL] - soles[:, :, HEEL]
    noses = _stood(along, flat)
    if len(places) < 3:
        return False
    centred = places - places.mean(axis=0)
    slope, *_ = np.linalg.lstsq(centred[:, :2], centred[:, 2], rcond=1e-3)
    if math.atan(float(np.linalg.norm(slope))) < _MOST_TILT:
        return False
    wanted = noses[:, :2] @ slope
    share = float(np.sum(noses[:, 2] * wanted) / max(float(np.sum(wanted * wanted)), 1e-12))
    return share > 0.5


def _fitted_sole(leg: Leg, rotations: Array) -> Sole:
    """The sole whose frame is upright in these standing poses (N, J, 4)."""
    foot = rotations[:, leg.ankle]
    up = quat_arrays.rotate(quat_arrays.conj(foot), _UP).mean(axis=0)
    frame = np.array(quat_upright(rotate(tuple(leg.sole.frame), (1.0, 0.0, 0.0)), tuple(up)))
    if leg.toe < 0:
        return replace(leg.sole, frame=frame)
    lying = quat_arrays.mul(quat_arrays.conj(rotations[:, leg.toe]), quat_arrays.mul(foot, frame))
    lying *= np.where(lying @ lying[0] < 0.0, -1.0, 1.0)[:, None]
    return replace(leg.sole, frame=frame, toe_frame=quat_arrays.unit(lying.mean(axis=0)))


def _padded(clip: Clip, rig: Rig, scale: float, notes: list[str]) -> tuple[Clip, int, bool]:
    """A loop with some of the cycles before and after it, so that its ends are like its middle.

    Returns it with how many frames there are on either side, and whether its last is its first
    again. Whatever is told from the motion is told from all of them: a cycle in place is too short
    to tell its belt.
    """
    closed = _closes(clip, rig, scale)
    if not closed and not _would_close(clip, rig, scale):
        return clip, 0, False
    if not clip.loop:
        again = (
            "the last pose is the first again" if closed else "after the last pose comes the first"
        )
        notes.append(f"{again}: cleaned as a loop")
    cycle = clip if closed else _with_first_again(clip)
    pad = min(len(cycle) - 1, math.ceil(_PADDING * clip.fps))
    yaw, step = stride(cycle, rig) if closed else (0.0, np.zeros(3))
    around = _around_clip(cycle, quat_arrays.about(_UP, yaw), step, pad)
    return around, pad, closed


def stride(clip: Clip, rig: Rig) -> tuple[float, Array]:
    """What one cycle adds to the body: yaw (rad) about the origin, and displacement (3,), m.

    As `Clip.stride`, of the hips: their root may stay where it is and translations carry them.
    """
    positions, rotations = _model_pose(clip, [0, len(clip) - 1])
    first, last = rotations[:, rig.hips]
    yaw = float(quat_heading(tuple(quat_arrays.mul(last, quat_arrays.conj(first)))))
    start, stop = positions[:, rig.hips]
    return yaw, stop - quat_arrays.rotate(quat_arrays.about(_UP, np.array(yaw)), start)


def _model_pose(clip: Clip, frames: list[int]) -> tuple[Array, Array]:
    """Positions (N, J, 3) and rotations (N, J, 4) of some frames."""
    moved = None if clip.translations is None else clip.translations[frames]
    return clip.skeleton.forward(clip.rotations[frames], clip.root_positions[frames], moved)


def _closes(clip: Clip, rig: Rig, scale: float) -> bool:
    """Whether the clip says that it loops, or ends in the pose in which it began."""
    if clip.loop:
        return len(clip) > 1
    if clip.duration < _SHORTEST_LOOP:
        return False
    yaw, step = stride(clip, rig)
    ends = [0, len(clip) - 1]
    first, last = clip.rotations[ends]
    # What carries the hips may share their turn in any way.
    first[clip.skeleton.chain(rig.hips)] = last[clip.skeleton.chain(rig.hips)] = _IDENTITY
    first[rig.hips], last[rig.hips] = _model_pose(clip, ends)[1][:, rig.hips]
    first[rig.hips] = quat_arrays.mul(quat_arrays.about(_UP, np.array(yaw)), first[rig.hips])
    return _most_turned(first, last) <= _SAME_TURN and abs(step[2]) <= _SAME_PLACE * scale


def _would_close(clip: Clip, rig: Rig, scale: float) -> bool:
    """Whether the first pose would come next after the last: a loop in place without its end.

    The step from the last to the first is then no larger than the steps beside it, and the soles
    go on as they do there.
    """
    if clip.duration < _SHORTEST_LOOP:
        return False
    again = [len(clip) - 2, len(clip) - 1, 0, 1]
    positions, rotations = _model_pose(clip, again)
    turns = [_most_turned(*clip.rotations[again[i : i + 2]]) for i in range(3)]
    ways = np.linalg.norm(np.diff(positions[:, rig.hips], axis=0), axis=-1)
    small = ways[1] <= max(ways[0], ways[2]) + _SAME_PLACE * scale
    follows = _SAME_TURN < turns[1] <= max(turns[0], turns[2])
    return bool(
        small and follows and _soles_go_on(all_sole_points(rig, positions, rotations), scale)
    )


def _soles_go_on(soles: Array, scale: float) -> bool:
    """Whether the steps of soles (4, F, 3, 3) over a seam are between those before and after it.

    On a belt a foot that stands goes back by as much each frame: a pose that is there twice, as
    the last and as the first, would stop it.
    """
    before, seam, after = np.diff(soles, axis=0)
    way = after - before
    share = np.sum((seam - before) * way, axis=-1) / np.maximum(np.sum(way * way, axis=-1), 1e-18)
    off = seam - before - np.clip(share, 0.0, 1.0)[..., None] * way
    usual = np.maximum(np.linalg.norm(before, axis=-1), np.linalg.norm(after, axis=-1))
    most = _BESIDE * usual + _SAME_PLACE * scale
    return bool((np.linalg.norm(off, axis=-1) <= most).all())


def _most_turned(a: Array, b: Array) -> float:
    """How far the joint turns that turns most from pose a to b (J, 4), rad."""
    apart = quat_arrays.to_rotvec(quat_arrays.mul(quat_arrays.conj(a), b))
    return float(np.linalg.norm(apart, axis=-1).max())


def _with_first_again(clip: Clip) -> Clip:
    """The clip with its first frame once more at its end."""
    again = [*range(len(clip)), 0]
    moved = clip.translations
    return replace(
        clip,
        root_positions=clip.root_positions[again],
        rotations=clip.rotations[again],
        translations=None if moved is None else moved[again],
        curves={name: np.asarray(v)[again] for name, v in clip.curves.items()},
    )


def _turned(turn: Array, rotations: Array) -> Array:
    return quat_arrays.mul(turn, rotations)


def _unturned(turn: Array, rotations: Array) -> Array:
    return quat_arrays.mul(quat_arrays.conj(turn), rotations)


def _around_points(points: Array, turn: Array, step: Array, pad: int) -> Array:
    """(T + 2 pad, ...) points (T, ..., 3) with those of the cycles around."""
    return _around(
        points,
        pad,
        lambda p: quat_arrays.rotate(turn, p) + step,
        lambda p: quat_arrays.rotate(quat_arrays.conj(turn), p - step),
    )


def _around(values: Array, pad: int, later, earlier) -> Array:
    """Values (T, ...) of a cycle with `pad` frames of its neighbours, seen one cycle on or back."""
    last = len(values) - 1
    before, after = values[last - pad : last], values[1 : 1 + pad]
    return np.concatenate([earlier(before), values, later(after)])


def _around_clip(clip: Clip, turn: Array, step: Array, pad: int) -> Clip:
    same = lambda v: v  # noqa: E731
    rotations = _around(clip.rotations, pad, same, same)
    rotations[:pad, 0] = _unturned(turn, rotations[:pad, 0])
    rotations[len(rotations) - pad :, 0] = _turned(turn, rotations[len(rotations) - pad :, 0])
    moved = clip.translations
    return replace(
        clip,
        root_positions=_around_points(clip.root_positions, turn, step, pad),
        rotations=rotations,
        translations=None if moved is None else _around(moved, pad, same, same),
        curves={n: _around(np.asarray(v), pad, same, same) for n, v in clip.curves.items()},
        loop=False,
    )
