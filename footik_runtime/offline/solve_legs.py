"""Solve legs: turn thigh, shin, foot and toes so that every foot goes where its path says.

The root has moved and the feet have new goals. Each leg is solved by `two_bone`, frame by frame;
its knee stays in the plane it was bent in. What is not asked is not touched, to the last bit.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from footik_runtime import quat_arrays
from footik_runtime.compiled import compiled
from footik_runtime.leg_ik import soft_stretch, two_bone
from footik_runtime.math3d import (
    add,
    get3,
    get4,
    norm,
    quat_conj,
    quat_from_rotvec,
    quat_mul,
    quat_unit,
    rotate,
    set4,
    sub,
)
from footik_runtime.offline.stages import Array, Bools, CleanSettings, FootPaths, Working
from footik_runtime.rig import Leg, Rig

_UP = np.array([0.0, 0.0, 1.0])
_LONGEST = 1.0 - 1e-7  # part of a leg's length: its knee is never quite straight
_UNBENT = 1e-9  # m^2: thigh x shin of a leg that bends in no frame


def solve(
    work: Working, paths: FootPaths, root_moves: Array, settings: CleanSettings
) -> tuple[Array, Array | None, Bools]:
    """Leg joints for a moved root (N, 3) and moved feet.

    Returns:
        Local rotations (N, J, 4); local translations (N, J, 3), or None where the clip has none
        and no leg is stretched; and (N, F) whether each foot comes to its goal.
    """
    clip, rig = work.clip, work.rig
    rotations = clip.rotations.copy()
    reached = np.ones((len(clip), len(rig.legs)), dtype=bool)
    stretches = np.ones(reached.shape)
    usable = usable_lengths(work, settings)
    hinges = knee_hinges(work)
    chains = np.array([(leg.hip, leg.knee, leg.ankle, leg.toe) for leg in rig.legs])
    _solve_frames(
        rig.skeleton.parents,
        chains.astype(np.int64).reshape(-1, 4),
        work.positions,
        work.rotations,
        np.ascontiguousarray(root_moves),
        np.ascontiguousarray(paths.moves),
        np.ascontiguousarray(paths.turns),
        np.ascontiguousarray(paths.toe_turns),
        hinges,
        usable,
        1.0 + settings.stretch,
        rotations,
        stretches,
        reached,
    )
    return rotations, _stretched(work, stretches), reached


def knee_hinges(work: Working) -> Array:
    """(F, 3) each knee's axis in its thigh's frame, pointing left where knees bend as a man's.

    The mean of thigh x shin over all frames, which the most bent ones dominate; that of the rest
    pose for a leg that bends in none, and the rig's left for one that does not bend there either.
    """
    return np.array([_knee_hinge(work, leg) for leg in work.rig.legs]).reshape(-1, 3)


def _knee_hinge(work: Working, leg: Leg) -> Array:
    rest = work.rig.skeleton.rest_pose()
    for positions, rotations in (
        (work.positions, work.rotations),
        (rest[0][None], rest[1][None]),
    ):
        hip, knee, ankle = (positions[:, j] for j in (leg.hip, leg.knee, leg.ankle))
        bent = quat_arrays.rotate(
            quat_arrays.conj(rotations[:, leg.hip]), np.cross(knee - hip, ankle - knee)
        ).sum(axis=0)
        if np.linalg.norm(bent) > _UNBENT * len(positions):
            return quat_arrays.unit(bent)
    left = np.cross(_UP, work.rig.forward)
    return quat_arrays.unit(quat_arrays.rotate(quat_arrays.conj(rest[1][leg.hip]), left))


def leg_spans(rig: Rig, positions: Array) -> tuple[Array, Array]:
    """Of poses (N, J, 3): (N, F) the legs' lengths hip-knee-ankle, and hip to ankle, m."""
    chains = np.array([(leg.hip, leg.knee, leg.ankle) for leg in rig.legs]).reshape(-1, 3)
    lengths, spans = (np.empty((len(positions), len(chains))) for _ in range(2))
    _measure_legs(chains, positions, lengths, spans)
    return lengths, spans


def usable_lengths(work: Working, settings: CleanSettings) -> Array:
    """(N, F) how far each leg reaches without stretch, m: a share of its length, or what it does.

    A leg that the input extends further may do so still, or its knee would pop.
    """
    length, extension = leg_spans(work.rig, work.positions)
    return np.minimum(np.maximum(settings.reach * length, extension), _LONGEST * length)


def _stretched(work: Working, stretches: NDArray[np.float64]) -> Array | None:
    """The clip's translations with the bones of stretched legs lengthened, or as they are."""
    clip, skeleton = work.clip, work.rig.skeleton
    if not (stretches > 1.0).any():
        return clip.translations
    moved = clip.translations
    out = np.tile(skeleton.offsets, (len(clip), 1, 1)) if moved is None else moved.copy()
    for f, leg in enumerate(work.rig.legs):
        longer = stretches[:, f] > 1.0
        above = set(skeleton.chain(leg.hip))
        for joint in skeleton.chain(leg.ankle):
            if joint not in above:
                out[longer, joint] *= stretches[longer, f, None]
    return out


@compiled
def _measure_legs(chains, positions, lengths, spans):
    for t in range(positions.shape[0]):
        for f in range(chains.shape[0]):
            hip, knee, ankle = (
                get3(positions[t, chains[f, 0]]),
                get3(positions[t, chains[f, 1]]),
                get3(positions[t, chains[f, 2]]),
            )
            lengths[t, f] = norm(sub(knee, hip)) + norm(sub(ankle, knee))
            spans[t, f] = norm(sub(ankle, hip))


@compiled
def _solve_frames(
    parents, chains, positions, rotations, roots, moves, turns, toe_turns, hinges, usable, most,
    out, stretches, reached,
):  # fmt: skip
    for t in range(positions.shape[0]):
        root = get3(roots[t])
        for f in range(chains.shape[0]):
            move, turn = get3(moves[t, f]), get3(turns[t, f])
            toe_turn = get3(toe_turns[t, f])
            if norm(root) == 0.0 and norm(move) == 0.0 and norm(turn) == 0.0:
                if norm(toe_turn) > 0.0 and chains[f, 3] >= 0:
                    _turn_toes(parents, chains[f, 3], rotations[t], turn, toe_turn, out[t])
                continue
            stretches[t, f], reached[t, f] = _solve_leg(
                parents, chains[f], positions[t], rotations[t], root, move, turn,
                get3(hinges[f]), usable[t, f], most, out[t],
            )  # fmt: skip
            if norm(toe_turn) > 0.0 and chains[f, 3] >= 0:
                _turn_toes(parents, chains[f, 3], rotations[t], turn, toe_turn, out[t])


@compiled
def _solve_leg(
    parents, chain, positions, rotations, root, move, turn, hinge, usable, most, out
):  # fmt: skip
    """Write hip, knee and ankle of one leg; returns its stretch and whether it reaches."""
    hip, knee, ankle = chain[0], chain[1], chain[2]
    at = add(get3(positions[hip]), root)
    knee_at = add(get3(positions[knee]), root)
    ankle_at = add(get3(positions[ankle]), root)
    goal = add(get3(positions[ankle]), move)
    axis = rotate(get4(rotations[hip]), hinge)
    thigh_turn, shin_turn, _, there = two_bone(
        at, knee_at, ankle_at, goal, axis, usable, (0.0, 0.0, 0.0), most
    )
    full = _LONGEST * (norm(sub(knee_at, at)) + norm(sub(ankle_at, knee_at)))
    _, stretch = soft_stretch(norm(sub(goal, at)), min(usable, full), full, most)
    above = get4(rotations[parents[hip]]) if parents[hip] >= 0 else (1.0, 0.0, 0.0, 0.0)
    _write_local(out[hip], above, quat_mul(thigh_turn, get4(rotations[hip])))
    above = quat_mul(thigh_turn, get4(rotations[parents[knee]]))
    _write_local(out[knee], above, quat_mul(shin_turn, get4(rotations[knee])))
    above = quat_mul(shin_turn, get4(rotations[parents[ankle]]))
    foot = quat_mul(quat_from_rotvec(turn), get4(rotations[ankle]))
    _write_local(out[ankle], above, foot)
    return stretch, there


@compiled
def _turn_toes(parents, toe, rotations, turn, toe_turn, out):
    """Write the toe joint, turned once more after it has turned with the foot."""
    with_foot = quat_from_rotvec(turn)
    above = quat_mul(with_foot, get4(rotations[parents[toe]]))
    toes = quat_mul(quat_mul(quat_from_rotvec(toe_turn), with_foot), get4(rotations[toe]))
    _write_local(out[toe], above, toes)


@compiled
def _write_local(out, above, world):
    """Write a joint's local rotation, of the sign that it had."""
    local = quat_unit(quat_mul(quat_conj(above), world))
    same = out[0] * local[0] + out[1] * local[1] + out[2] * local[2] + out[3] * local[3]
    sign = 1.0 if same >= 0.0 else -1.0
    set4(out, (sign * local[0], sign * local[1], sign * local[2], sign * local[3]))
