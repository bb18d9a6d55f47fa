"""Clean: footskate taken out of a clip, after Kovar's five steps (Kovar, Schreiner, Gleicher 2002).

Contacts are told, plants placed, feet posed, the root placed and the legs solved, all on a working
copy that is levelled, travelling and padded; the clip gets only what differs back.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from footik_runtime import quat_arrays
from footik_runtime.clip import Clip
from footik_runtime.compiled import compiled
from footik_runtime.offline import detect, footing, footplant, plants, root, solve_legs, spread
from footik_runtime.offline.filters import contact_spans
from footik_runtime.offline.stages import (
    Array,
    Cleaned,
    CleanSettings,
    Contacts,
    Ground,
    Plant,
    Working,
)
from footik_runtime.offline.working import fitted_rig, stride, unpad, working
from footik_runtime.rig import Rig, find_rig

_FEWEST_FRAMES = 3
_MOST_TOLD = 4  # contacts that a note names


def clean(
    clip: Clip,
    rig: Rig | None = None,
    *,
    settings: CleanSettings | None = None,
    ground: Ground | None = None,
) -> Cleaned:
    """The clip without footskate, and what was found on the way.

    Args:
        clip: any clip with legs.
        rig: its legs; found from names, else shape, by default.
        settings: the defaults where None.
        ground: true ground in the clip's frame; found from the plants where None.

    Raises:
        FootIKError: no legs are found, or the rig is of another skeleton.
    """
    settings = CleanSettings() if settings is None else settings
    rig = find_rig(clip.skeleton) if rig is None else rig
    if settings.preset == "footplant":
        return footplant.clean(clip, rig)
    work = working(clip, rig, settings=settings, ground=ground)
    if len(clip) < _FEWEST_FRAMES:
        return _untouched(clip, rig, work)
    contacts = detect.of_clip(work, settings)
    found, left = plants.credible(work, plants.find(work, contacts, settings, ground), settings)
    notes = _left_alone(work, _within(left, work)) + _flickers(_cropped(contacts, work))
    work = replace(work, notes=(*work.notes, *notes))
    paths = spread.spread(footing.poses(work, found, settings), work, found, settings, ground)
    root_moves = root.place(work, paths, settings)
    rotations, translations, reached = solve_legs.solve(work, paths, root_moves, settings)
    moves = unpad(work, root_moves).copy()
    if work.pad and work.closed:
        moves[-1] = quat_arrays.rotate(_turn(clip, rig), moves[0])
    within = _within(found, work)
    cleaned = _put_back(clip, work, moves, rotations, translations, settings)
    return Cleaned(
        clip=cleaned,
        rig=fitted_rig(rig, work),
        contacts=_cropped(contacts, work),
        plants=within,
        phases=unpad(work, plants.phases_of(found, contacts.foot.shape)),
        root_moves=moves,
        work=work,
        ground=ground,
        levelled=settings.level,
        report=_report(work, contacts, within, moves, reached | ~paths.pinned),
    )


def _left_alone(work: Working, left: tuple[Plant, ...]) -> list[str]:
    """What is said of contacts in which no foot is held."""
    if not left:
        return []
    spans = sorted({(p.foot, p.start, p.stop) for p in left})
    where = ", ".join(f"{work.rig.legs[f].name} {a}-{b - 1}" for f, a, b in spans[:_MOST_TOLD])
    more = ", ..." if len(spans) > _MOST_TOLD else ""
    return [
        f"left alone, for a foot held there would go far or stand steep: {where}{more} (frames)"
    ]


def _flickers(contacts: Contacts) -> list[str]:
    """What is said of contacts too short to be placed, which only curves tell."""
    spans = contact_spans(contacts.foot)
    inside = (spans[:, 1] > 0) & (spans[:, 2] < len(contacts.down))
    count = int((inside & plants.brief(spans, contacts.fps)).sum())
    return (
        [f"left alone, for they are too short: {count} contacts that curves tell"] if count else []
    )


def _untouched(clip: Clip, rig: Rig, work: Working) -> Cleaned:
    """A clip that is too short to tell a contact, as it is."""
    work = replace(work, pad=0)
    points = (len(clip), len(work.rig.legs), 2)
    contacts = Contacts(
        fps=clip.fps,
        down=np.zeros(points, dtype=bool),
        confidence=np.zeros(points),
        ground=np.zeros(points),
        belt=np.zeros(3),
    )
    still = np.zeros((len(clip), 3))
    report = _report(work, contacts, (), still, np.ones(points[:2], dtype=bool))
    report["notes"].append(f"{len(clip)} frames are too few to clean")
    return Cleaned(
        clip=clip,
        rig=fitted_rig(rig, work),
        contacts=contacts,
        plants=(),
        phases=contacts.phases(),
        root_moves=still,
        work=work,
        report=report,
    )


def _turn(clip: Clip, rig: Rig) -> Array:
    """(4,) what a loop's heading turns by in a cycle."""
    return quat_arrays.about([0.0, 0.0, 1.0], np.array(stride(clip, rig)[0]))


def _put_back(
    clip: Clip,
    work: Working,
    moves: Array,
    rotations: Array,
    translations: Array | None,
    settings: CleanSettings,
) -> Clip:
    """The input with the root moved and the leg joints turned that differ from the working clip's.

    Everything else is the input's to the last bit, so that files keep its digits.
    """
    turned, given = clip.rotations.copy(), work.clip
    legs = [j for g in work.rig.legs for j in (g.hip, g.knee, g.ankle, g.toe) if j >= 0]
    _write_changed(
        unpad(work, given.rotations), unpad(work, rotations), np.array(legs), work.joints, turned,
        work.pad > 0 and work.closed,
    )  # fmt: skip
    offsets, lengths = moves, clip.translations
    if translations is not None and translations is not given.translations:
        lengths = _lengths(clip).copy()
        lengths[:, work.joints] = unpad(work, translations)
    if settings.level:
        upright = quat_arrays.conj(work.back)
        turned[:, 0] = quat_arrays.mul(upright, turned[:, 0])
        roots = quat_arrays.rotate(upright, clip.root_positions) + offsets
    else:
        roots = clip.root_positions + quat_arrays.rotate(work.back, offsets)
    if lengths is not clip.translations:
        return replace(clip, root_positions=roots, rotations=turned, translations=lengths)
    return clip.moved(roots, turned)


@compiled
def _write_changed(before, after, legs, joints, out, closed):
    """Write leg rotations (T, K, 4) that changed into out (T, J, 4), of the sign that those have.

    A padded clip's may have the other. A loop's last frame is its first again to the last bit,
    where its pads agree but to rounding.
    """
    last = before.shape[0] - 1
    for j in legs:
        moved = _differs(before[0, j], after[0, j]) or _differs(before[last, j], after[last, j])
        for t in range(last + 1):
            source = 0 if closed and moved and t == last else t
            if _differs(before[t, j], after[source, j]):
                place = out[t, joints[j]]
                same = 0.0
                for c in range(4):
                    same += place[c] * after[source, j, c]
                for c in range(4):
                    place[c] = -after[source, j, c] if same < 0.0 else after[source, j, c]


@compiled
def _differs(a, b):
    return a[0] != b[0] or a[1] != b[1] or a[2] != b[2] or a[3] != b[3]


def _lengths(clip: Clip) -> Array:
    """(T, J, 3) local translations, m."""
    if clip.translations is not None:
        return clip.translations
    return np.tile(clip.skeleton.offsets, (len(clip), 1, 1))


def _cropped(contacts: Contacts, work: Working) -> Contacts:
    return replace(
        contacts,
        down=unpad(work, contacts.down),
        confidence=unpad(work, contacts.confidence),
        ground=unpad(work, contacts.ground),
    )


def _within(found: tuple[Plant, ...], work: Working) -> tuple[Plant, ...]:
    """The plants that touch the clip's own frames, counted in them."""
    inside = []
    for plant in found:
        if plant.stop <= work.pad or plant.start >= work.pad + work.frames:
            continue
        frames = (plant.start, plant.flat, plant.roll, plant.stop)
        start, flat, roll, stop = (min(max(t - work.pad, 0), work.frames) for t in frames)
        inside.append(replace(plant, start=start, flat=flat, roll=roll, stop=stop))
    return tuple(inside)


def _report(
    work: Working,
    contacts: Contacts,
    found: tuple[Plant, ...],
    moves: Array,
    reached: NDArray[np.bool_],
) -> dict[str, Any]:
    """What was found and done, of what JSON holds."""
    legs = [leg.name for leg in work.rig.legs]
    down = unpad(work, contacts.foot)
    largest = float(np.linalg.norm(moves, axis=-1).max()) if len(moves) else 0.0
    return {
        "contacts": {
            "share": {n: float(down[:, f].mean()) for f, n in enumerate(legs)},
            "noise_mm": 1000.0 * contacts.noise if math.isfinite(contacts.noise) else 0.0,
            "smoothing_ms": 1000.0 * contacts.sigma,
            "belt": [float(v) for v in contacts.belt],
        },
        "plants": [
            {
                "foot": legs[plant.foot],
                "start": plant.start,
                "flat": plant.flat,
                "roll": plant.roll,
                "stop": plant.stop,
                "place": [float(v) for v in 0.5 * (plant.heel + plant.ball)],
                "change_mm": 1000.0 * plant.change,
            }
            for plant in found
        ],
        "loop": work.pad > 0,
        "root_largest_mm": 1000.0 * largest,
        "unreached_frames": int((~unpad(work, reached)).any(axis=-1).sum()),
        "notes": list(work.notes),
    }
