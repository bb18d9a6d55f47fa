"""Plants: where each contact holds the foot, on ground that is given or found from the plants."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from footik_runtime import quat_arrays
from footik_runtime.offline.filters import contact_spans
from footik_runtime.offline.footprints import Footprints, footprints, still_ends
from footik_runtime.offline.stages import (
    Bools,
    CleanSettings,
    Contacts,
    Ground,
    Ints,
    Plant,
    Working,
)
from footik_runtime.offline.stretches import stands
from footik_runtime.phases import Phase

Array = NDArray[np.float64]

# Of a body whose legs are 0.85 m long; lengths scale with the leg.
_UNEVEN = 0.015  # m: plants farther from a plane than this lie on none
_MADE = 0.001  # m: the same where feet stand quite still, so that their heights can be believed
_PER_WOBBLE = 4.0  # and between: this times what a foot's height varies by while it stands
_STEEP = math.radians(4.0)  # a plane steeper than this must show in the soles
_PITCHED = math.radians(5.0)  # a foot that stands so on its own tells its ground
_STEEPEST = math.radians(35.0)  # ground on which a foot still stands
_NARROW = 0.12  # m: plants spread less than this say nothing of the slope that way
_ONE_TREAD = 1.0  # s between plants that may share a tread
_SHORTEST = 0.08  # s of a contact that is placed
_UP = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True, kw_only=True, eq=False)
class FoundGround:
    """What each contact stands on, told from all of them.

    kind: "given", "plane" or "per plant". heights: (K,) m under each footprint's place.
    normals: (K, 3) unit.
    """

    kind: str
    heights: Array
    normals: Array


def find(
    work: Working, contacts: Contacts, settings: CleanSettings, ground: Ground | None = None
) -> tuple[Plant, ...]:
    """Every contact as plants, by foot and time; one that rocks back is plants without a gap.

    A plant holds what moves its pinned points least: the mean of where each frame has its
    footprint. `change` is that of the whole contact; under `keep_below` nothing is asked of it.
    """
    spans = contact_spans(contacts.foot)
    spans = spans[~brief(spans, contacts.fps)]
    if not len(spans):
        return ()
    spans = stands(work, spans)
    prints = footprints(work, contacts, spans)
    found = found_ground(prints, work.scale, settings.snap)
    heels, balls, normals = _held(work, prints, found, ground)
    keep = settings.keep_below * work.scale
    change, prints = still_ends(work, prints, heels, balls, keep)
    turns = _turns(heels, balls, normals)
    return tuple(
        Plant(
            foot=int(spans[k, 0]),
            start=int(start),
            flat=int(flat),
            roll=int(roll),
            stop=int(stop),
            heel=heels[k],
            ball=balls[k],
            turn=turns[k],
            normal=normals[k],
            change=float(change[k]),
        )
        for k, start, flat, roll, stop in zip(
            prints.contact, prints.start, prints.flat, prints.roll, prints.stop, strict=True
        )
        if start < stop
    )


def credible(
    work: Working, found: tuple[Plant, ...], settings: CleanSettings
) -> tuple[tuple[Plant, ...], tuple[Plant, ...]]:
    """The plants in which a foot can have stood, and the others, which are better left alone.

    Where a body sits, lies, rolls or jumps, feet are slow without standing: held, they would go
    far, or stand on ground as steep as a shin that lies.
    """
    most = settings.leave_above * work.scale
    level = math.cos(_STEEPEST)
    good, left = [], []
    for plant in found:
        (good if plant.change <= most and plant.normal[2] >= level else left).append(plant)
    return tuple(good), tuple(left)


def brief(spans: Ints, fps: float) -> Bools:
    """(K,) contacts too short to be placed: the clip cuts them off, or a curve flickers."""
    return np.asarray(spans[:, 2] - spans[:, 1] < _SHORTEST * fps)


def phases_of(plants: tuple[Plant, ...], shape: tuple[int, int]) -> NDArray[np.int8]:
    """(N, F) `Phase` by the plants."""
    phases = np.zeros(shape, dtype=np.int8)
    for plant in plants:
        phases[plant.start : plant.flat, plant.foot] = Phase.HEEL
        phases[plant.flat : plant.roll, plant.foot] = Phase.FLAT
        phases[plant.roll : plant.stop, plant.foot] = Phase.BALL
    return phases


def found_ground(prints: Footprints, scale: float, snap: bool = True) -> FoundGround:
    """The plane that all footprints lie on, or else the height of each.

    How far plants may be off a plane follows from how much the height of a standing foot varies.
    A regular stair is a plane too, but not to its soles.
    """
    wobble = float(np.median(prints.wobble))
    uneven = min(_UNEVEN * scale, max(_MADE * scale, _PER_WOBBLE * wobble))
    places = prints.places
    plane = _level_plane(prints, uneven) or _slope(prints, scale, uneven)
    if snap and plane is not None:
        height, slope = plane
        normal = quat_arrays.unit(np.array([-slope[0], -slope[1], 1.0]))
        heights = height + places[:, :2] @ slope
        return FoundGround(kind="plane", heights=heights, normals=np.tile(normal, (len(places), 1)))
    heights = _treads(prints, uneven) if snap else places[:, 2]
    return FoundGround(kind="per plant", heights=heights, normals=_own_normals(prints))


def _level_plane(prints: Footprints, uneven: float) -> tuple[float, Array] | None:
    """Height of the level plane through the footprints, as the flat ones tell it, or None."""
    heights = prints.places[:, 2]
    if np.ptp(heights) > 2.0 * uneven:
        return None
    sure = prints.has_flat if prints.has_flat.any() else np.ones(len(heights), dtype=bool)
    return float(heights[sure].mean()), np.zeros(2)


def _slope(prints: Footprints, scale: float, uneven: float) -> tuple[float, Array] | None:
    """Height at the origin and slope (2,) of the plane through the footprints, or None."""
    points = prints.places
    middle = points.mean(axis=0)
    centred = points - middle
    spreads, axes = np.linalg.eigh(centred[:, :2].T @ centred[:, :2] / len(points))
    told = spreads > (_NARROW * scale) ** 2
    along = axes.T @ (centred[:, :2].T @ centred[:, 2]) / len(points)
    slope = axes @ np.where(told, along / np.where(told, spreads, 1.0), 0.0)
    if np.abs(centred[:, 2] - centred[:, :2] @ slope).max() > uneven:
        return None
    if math.atan(float(np.linalg.norm(slope))) > _STEEP and not _lies_on(prints, slope):
        return None
    return float(middle[2] - middle[:2] @ slope), slope


def _lies_on(prints: Footprints, slope: Array) -> bool:
    """Whether the soles lie to a slope (2,) more than to the level."""
    wanted = prints.directions[:, :2] @ slope
    square = float(np.sum(wanted[prints.has_flat] ** 2))
    has = float(np.sum((wanted * prints.directions[:, 2])[prints.has_flat]))
    return square < 1e-9 or has > 0.5 * square


def _treads(prints: Footprints, uneven: float) -> Array:
    """(K,) heights of the footprints, one for those that follow each other on one tread."""
    heights = prints.places[:, 2].copy()
    order = np.argsort(prints.spans[:, 1], kind="stable")
    group: list[int] = []
    latest = 0
    for k in order:
        start, stop = prints.spans[k, 1:]
        near = group and start - latest < _ONE_TREAD * prints.fps
        mean = float(prints.places[group, 2].mean()) if group else 0.0
        if not (near and abs(prints.places[k, 2] - mean) < uneven):
            group = []
        group.append(int(k))
        latest = max(latest, int(stop)) if len(group) > 1 else int(stop)
        heights[group] = prints.places[group, 2].mean()
    return heights


def _own_normals(prints: Footprints) -> Array:
    """(K, 3): up, but square to the sole of a foot that stands flat and pitched."""
    along = prints.directions
    pitch = np.arctan2(along[:, 2], np.hypot(along[:, 0], along[:, 1]))
    tilted = prints.has_flat & (np.abs(pitch) > _PITCHED)
    left = quat_arrays.unit(np.cross(_UP, along))
    return np.where(tilted[:, None], np.cross(along, left), _UP)


def _held(
    work: Working, prints: Footprints, found: FoundGround, ground: Ground | None
) -> tuple[Array, Array, Array]:
    """Where heels and balls (K, 3) are held, and the ground's normals (K, 3) there."""
    heel, ball = np.array([(leg.sole.heel, leg.sole.ball) for leg in work.rig.legs])[
        prints.spans[:, 0]
    ].T
    normals = found.normals
    # The foot points along the ground, vertically over where it did.
    lift = np.sum(prints.directions[:, :2] * normals[:, :2], axis=1) / normals[:, 2]
    along = prints.directions.copy()
    along[:, 2] = -lift
    along = quat_arrays.unit(along)
    middle = prints.places.copy()
    middle[:, 2] = found.heights
    middle += prints.ahead[:, None] * along
    heels, balls = middle - heel[:, None] * along, middle + ball[:, None] * along
    if ground is None:
        return heels, balls, normals
    # Over a belt the ground of the clip passes under a plant: it lies as in the plant's middle.
    middles = (prints.spans[:, 1] + prints.spans[:, 2] - 1) // 2
    return _on_given(ground, heels, balls, normals, work.shift[middles])


def _on_given(
    ground: Ground, heels: Array, balls: Array, normals: Array, shift: Array
) -> tuple[Array, Array, Array]:
    """The same on the true ground; where it has none, on the found.

    shift: (K, 3) by which the working clip is off the clip whose ground it is.
    """
    length = np.linalg.norm(balls - heels, axis=1, keepdims=True)
    low, high = heels.copy(), balls.copy()
    low[:, 2] = ground.height(heels - shift) + shift[:, 2]
    high[:, 2] = ground.height(balls - shift) + shift[:, 2]
    known = (np.isfinite(low[:, 2]) & np.isfinite(high[:, 2]))[:, None]
    along = quat_arrays.unit(np.where(known, high - low, balls - heels))
    true = ground.normal(np.where(known, 0.5 * (low + high), 0.5 * (heels + balls)) - shift)
    normal = quat_arrays.unit(true - along * np.sum(true * along, axis=1, keepdims=True))
    good = known & np.isfinite(normal).all(axis=1, keepdims=True) & (normal[:, 2:] > 0.1)
    held = np.where(good, low, heels)
    return held, np.where(good, low + length * along, balls), np.where(good, normal, normals)


def _turns(heels: Array, balls: Array, normals: Array) -> Array:
    """(K, 4) rotations whose x points from heel to ball and whose z is the ground's normal."""
    along = quat_arrays.unit(balls - heels)
    left = np.cross(normals, along)
    return quat_arrays.from_bone(np.cross(along, left), left)
