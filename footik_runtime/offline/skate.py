"""Skate: generated walks whose true footprints are known, and the same with feet that slide.

A gait made by formulas stands exactly still. It is laid on flat ground, a slope or stairs, and then
its feet are moved in a known way during each contact, as a bad retarget moves them. The move is
zero on average over each contact, for of a slide nobody can tell where in it the foot was right.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from footik_runtime import quat_arrays
from footik_runtime.clip import Clip
from footik_runtime.errors import FootIKError, unknown_name
from footik_runtime.inertia import smooth_step
from footik_runtime.offline.filters import gaussian, runs
from footik_runtime.offline.solve_legs import leg_spans, solve
from footik_runtime.offline.stages import Array, Bools, CleanSettings, FootPaths, Ints, Working
from footik_runtime.phases import Phase, phase_curve
from footik_runtime.rig import Rig
from footik_runtime.sole import BALL, HEEL, all_sole_points

KINDS: tuple[str, ...] = ("constant", "accelerating", "noise", "drift")
GROUNDS: tuple[str, ...] = ("flat", "slope", "stairs")

_SLOPE = 0.15  # rise over run of the slope, about 8.5 degrees
_RISE = 0.15  # of a stair, in a leg of 0.85 m
_LEG = 0.85  # m
_EXTENDED = 0.985  # part of a leg's length that the true motion uses at most
_NOISE_CUT = 6.0  # Hz
_FADE = 0.15  # s in which a slide is taken back in swing


@dataclass(frozen=True, kw_only=True, eq=False)
class Truth:
    """A clip whose feet stand where they should, and what it stands on.

    Attributes:
        clip: without curves, as if it were captured.
        rig: whose.
        phases: (T, F) `Phase` of each foot.
        soles: (T, F, 3, 3) heel, ball and tip, m.
        height: ground height (N,) under points (N, 3), m.
        normal: its unit normal (N, 3) there.
    """

    clip: Clip
    rig: Rig
    phases: Ints
    soles: Array
    height: Callable[[Array], Array]
    normal: Callable[[Array], Array]

    def places(self, foot: int) -> list[tuple[int, int, Array]]:
        """(start, stop, place (3,)) of each contact: the middle of heel and ball while flat."""
        out = []
        for start, stop in runs(self.phases[:, foot] != Phase.SWING):
            flat = np.flatnonzero(self.phases[start:stop, foot] == Phase.FLAT) + start
            if len(flat):
                middle = self.soles[flat, foot][:, [HEEL, BALL]].mean(axis=(0, 1))
                out.append((int(start), int(stop), middle))
        return out


def true_walk(gait: Clip, rig: Rig, *, cycles: int = 4, ground: str = "flat") -> Truth:
    """Some cycles of a looping gait with phase curves, without them, on a ground of GROUNDS.

    A slope turns the feet's paths as they are and keeps the body upright; stairs lift each contact
    by a step, under a body that rises evenly. The body is lowered until no leg is quite straight.
    Raises FootIKError for another ground, or a gait without phases.
    """
    if ground not in GROUNDS:
        raise unknown_name("ground", ground, GROUNDS)
    for leg in rig.legs:
        if phase_curve(leg.name) not in gait.curves:
            raise FootIKError(f"{gait.name} has no curve {phase_curve(leg.name)!r}.")
    poses = [gait.sample(t) for t in np.arange((len(gait) - 1) * cycles + 1) / gait.fps]
    clip = Clip(
        skeleton=gait.skeleton,
        fps=gait.fps,
        root_positions=np.array([p.root_position for p in poses]),
        rotations=np.array([p.rotations for p in poses]),
        name=f"{gait.name} on {ground}",
    )
    frames = np.arange(len(clip)) % (len(gait) - 1)
    phases = np.stack(
        [np.round(np.asarray(gait.curves[phase_curve(g.name)]))[frames] for g in rig.legs], axis=1
    ).astype(np.int64)
    work = working_of(clip, rig)
    count = (len(clip), len(rig.legs))
    ankles = work.positions[:, [leg.ankle for leg in rig.legs]]
    moves, turns, root = np.zeros((*count, 3)), np.zeros((*count, 3)), np.zeros((len(clip), 3))
    height, normal = _level, _up
    if ground == "slope":
        turn = quat_arrays.about([0.0, 1.0, 0.0], np.array(-np.arctan(_SLOPE)))
        moves = quat_arrays.rotate(turn, ankles) - ankles
        turns[:] = quat_arrays.to_rotvec(turn)
        under = clip.root_positions * [1.0, 1.0, 0.0]
        root = quat_arrays.rotate(turn, under) - under
        height, normal = _slope, _slope_normal
    if ground == "stairs":
        steps = _Steps.of(work, phases)
        moves[..., 2] = steps.lifts
        root[:, 2] = steps.ramp
        height = steps.height
    root = _lowered(work, moves, root)
    paths = FootPaths(
        moves=moves, turns=turns, toe_turns=np.zeros_like(turns), pinned=phases != Phase.SWING
    )
    clip = _solved(work, paths, root)
    return Truth(
        clip=clip, rig=rig, phases=phases, soles=_soles(clip, rig), height=height, normal=normal
    )


def inject(truth: Truth, kind: str, size: float, seed: int = 0) -> Clip:
    """The true clip with feet that slide, horizontally and along the ground.

    Args:
        truth: from `true_walk`.
        kind: "constant" slides at an even speed, `size` m in all; "accelerating" ever faster, as
            far; "noise" moves by smooth noise under 6 Hz, of standard deviation `size`, along each
            axis; "drift" carries the whole body away by `size`, evenly over the clip.
        size: m.
        seed: of the directions, one for each contact, and of the noise.

    Raises:
        FootIKError: another kind, or a size that is negative or not finite.
    """
    if kind not in KINDS:
        raise unknown_name("kind of skate", kind, KINDS)
    if not (np.isfinite(size) and size >= 0.0):
        raise FootIKError(f"a skate's size must be 0 or more and finite, not {size}.")
    clip = truth.clip
    rng = np.random.default_rng(seed)
    if kind == "drift":
        way = np.linspace(-0.5, 0.5, len(clip))[:, None] * size
        angle = rng.uniform(0.0, 2.0 * np.pi)
        away = way * [np.cos(angle), np.sin(angle), 0.0]
        return replace(clip, root_positions=clip.root_positions + away)
    moves = np.zeros((*truth.phases.shape, 3))
    for f in range(truth.phases.shape[1]):
        contact = truth.phases[:, f] != Phase.SWING
        moves[:, f] = _slides(contact, kind, size, clip.fps, rng)
    normals = truth.normal(truth.soles[:, :, BALL].reshape(-1, 3)).reshape(moves.shape)
    moves[..., 2] = -(moves[..., 0] * normals[..., 0] + moves[..., 1] * normals[..., 1]) / np.where(
        normals[..., 2] > 0.1, normals[..., 2], 1.0
    )
    still = np.zeros_like(moves)
    paths = FootPaths(moves=moves, turns=still, toe_turns=still, pinned=truth.phases > 0)
    return _solved(working_of(clip, truth.rig), paths, np.zeros((len(clip), 3)))


def working_of(clip: Clip, rig: Rig) -> Working:
    """A clip as it is, for stages that want a `Working`: nothing levelled, nothing padded."""
    positions, rotations = clip.model_pose()
    return Working(
        clip=clip,
        rig=rig,
        joints=np.arange(len(rig.skeleton)),
        positions=positions,
        rotations=rotations,
        soles=all_sole_points(rig, positions, rotations),
        scale=float(rig.leg_lengths.mean()) / _LEG,
        back=np.array([1.0, 0.0, 0.0, 0.0]),
        shift=np.zeros((len(clip), 3)),
        belt=np.zeros(3),
        pad=0,
        frames=len(clip),
    )


def _slides(contact: Bools, kind: str, size: float, fps: float, rng: np.random.Generator) -> Array:
    """(T, 3) horizontal moves of one foot: zero on average over each contact, faded in swings."""
    out = np.zeros((len(contact), 3))
    noise = rng.normal(size=(len(contact), 2))
    noise = gaussian(noise, fps / (2.0 * np.pi * _NOISE_CUT))
    noise *= size / np.maximum(noise.std(axis=0), 1e-12)
    for start, stop in runs(contact):
        share = np.linspace(0.0, 1.0, stop - start)[:, None]
        angle = rng.uniform(0.0, 2.0 * np.pi)
        along = np.array([np.cos(angle), np.sin(angle)])
        if kind == "constant":
            slide = size * share * along
        elif kind == "accelerating":
            slide = size * share * share * along
        else:
            slide = noise[start:stop]
        out[start:stop, :2] = slide - slide.mean(axis=0)
    for start, stop in runs(~contact):
        most = max(min(_FADE * fps, 0.5 * (stop - start + 1)), 1.0)
        for t in range(start, stop):
            if start > 0:
                out[t] += out[start - 1] * (1.0 - smooth_step((t - start + 1) / most))
            if stop < len(contact):
                out[t] += out[stop] * (1.0 - smooth_step((stop - t) / most))
    return out


def _lowered(work: Working, moves: Array, root: Array) -> Array:
    """The root lowered by one length, so that no leg is longer than _EXTENDED of itself."""
    rig = work.rig
    hips = work.positions[:, [leg.hip for leg in rig.legs]] + root[:, None]
    goals = work.positions[:, [leg.ankle for leg in rig.legs]] + moves
    length, _ = leg_spans(rig, work.positions)
    flat = np.linalg.norm((hips - goals)[..., :2], axis=-1)
    upright = np.sqrt(np.maximum((_EXTENDED * length) ** 2 - flat**2, 0.0))
    drop = max(float((hips[..., 2] - goals[..., 2] - upright).max()), 0.0)
    return root - np.array([0.0, 0.0, drop])


def _solved(work: Working, paths: FootPaths, root: Array) -> Clip:
    settings = CleanSettings(reach=1.0)
    rotations, _, _ = solve(work, paths, root, settings)
    clip = work.clip
    return replace(clip, root_positions=clip.root_positions + root, rotations=rotations)


def _soles(clip: Clip, rig: Rig) -> Array:
    positions, rotations = clip.model_pose()
    return all_sole_points(rig, positions, rotations)


def _level(points: Array) -> Array:
    return np.zeros(len(points))


def _up(points: Array) -> Array:
    return np.tile([0.0, 0.0, 1.0], (len(points), 1))


def _slope(points: Array) -> Array:
    return _SLOPE * np.asarray(points)[:, 0]


def _slope_normal(points: Array) -> Array:
    return np.tile(quat_arrays.unit([-_SLOPE, 0.0, 1.0]), (len(points), 1))


@dataclass(frozen=True, kw_only=True, eq=False)
class _Steps:
    """Stairs under a walk: each contact one step higher than the one before it of either foot.

    lifts: (T, F) of the feet, m. ramp: (T,) of the root. edges: (S,) x where each tread begins.
    """

    lifts: Array
    ramp: Array
    edges: Array
    rise: float

    @classmethod
    def of(cls, work: Working, phases: Ints) -> _Steps:
        rise = _RISE * work.scale
        contacts = sorted(
            (float(work.soles[start:stop, f, [HEEL, BALL], 0].mean()), f, int(start), int(stop))
            for f in range(phases.shape[1])
            for start, stop in runs(phases[:, f] != Phase.SWING)
        )
        lifts = np.full(phases.shape, np.nan)
        middles = np.array([x for x, _, _, _ in contacts])
        for step, (_, f, start, stop) in enumerate(contacts):
            lifts[start:stop, f] = step * rise
        for f in range(phases.shape[1]):
            _climb(lifts[:, f])
        root = work.clip.root_positions[:, 0]
        ramp = np.interp(root, middles, np.arange(len(middles)) * rise)
        ramp = gaussian(ramp, 0.1 * work.clip.fps)
        return cls(lifts=lifts, ramp=ramp, edges=0.5 * (middles[1:] + middles[:-1]), rise=rise)

    def height(self, points: Array) -> Array:
        steps = np.searchsorted(self.edges, np.asarray(points)[:, 0])
        return self.rise * steps.astype(np.float64)


def _climb(lifts: Array) -> None:
    """Fill the swings (NaN) of one foot's lifts (T,): up early, as one does over an edge."""
    for start, stop in runs(np.isnan(lifts)):
        before = lifts[start - 1] if start else lifts[stop] if stop < len(lifts) else 0.0
        after = lifts[stop] if stop < len(lifts) else before
        for t in range(start, stop):
            share = smooth_step(1.4 * (t - start + 1) / (stop - start + 1))
            lifts[t] = before + (after - before) * share
