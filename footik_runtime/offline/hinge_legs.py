"""Hinge legs: the hinge angles that bring a robot's foot where a cleaned clip has it.

Damped least squares (Levenberg-Marquardt with a fixed damping) on all frames at once, from the
angles the frames had: the nearest solution, so that nothing flips. Where a leg has too few hinges
for a place and a rotation, the place goes first.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from footik_runtime import quat_arrays as qa

Array = NDArray[np.float64]

ROUNDS = 20
_DAMPING = 1e-9  # of the largest square in the Jacobian
_TURN_WEIGHT = 0.01  # of the chain's length: what a radian off weighs beside a metre off
_DONE = 1e-12  # m and rad: steps smaller than this end the search
_LARGEST_STEP = 0.3  # rad a round


@dataclass(frozen=True, kw_only=True, eq=False)
class Hinge:
    """One hinge of a link.

    column: its place among the chain's angles. axis, anchor: (3,) in its link's frame. zero: rad.
    """

    column: int
    axis: Array
    anchor: Array
    zero: float


@dataclass(frozen=True, kw_only=True, eq=False)
class Link:
    """A body of the chain: where it is in the one above, and its hinges, outermost first."""

    offset: Array
    turn: Array
    hinges: tuple[Hinge, ...]


@dataclass(frozen=True, kw_only=True, eq=False)
class Solved:
    """angles: (N, H) rad. off: (N,) m that the end misses its place. turned_off: (N,) rad."""

    angles: Array
    off: Array
    turned_off: Array


def solve_hinges(
    links: tuple[Link, ...],
    angles: Array,
    base: tuple[Array, Array],
    goal: tuple[Array, Array],
    limits: tuple[Array, Array],
    *,
    turn_only: bool = False,
) -> Solved:
    """Angles that bring the last link's origin and rotation to a goal, frame by frame.

    Args:
        links: from the hip to the foot.
        angles: (N, H) to start from, rad.
        base: place (N, 3) and rotation (N, 4) of the body above the first link, world.
        goal: place (N, 3) and rotation (N, 4) of the last link, world.
        limits: lowest and highest angle, (H,) each; a start beyond them may stay there.
        turn_only: the goal's place does not count.
    """
    angles = np.array(angles, dtype=np.float64)
    low = np.minimum(limits[0], angles)
    high = np.maximum(limits[1], angles)
    length = sum(float(np.linalg.norm(link.offset)) for link in links[1:])
    weight = 1.0 if turn_only else _TURN_WEIGHT * max(length, 1e-6)
    pull = 0.0 if turn_only else 1.0
    best, least = angles.copy(), np.full(len(angles), np.inf)
    for round_ in range(ROUNDS + 1):
        place, turn, axes, anchors = _forward(links, angles, base)
        error = np.concatenate(
            [pull * (goal[0] - place), weight * qa.to_rotvec(qa.mul(goal[1], qa.conj(turn)))],
            axis=-1,
        )
        cost = np.sum(error * error, axis=-1)
        better = cost < least
        best[better], least[better] = angles[better], cost[better]
        if round_ == ROUNDS:
            break
        arms = pull * (place[:, None] - anchors)
        step = _step(axes, arms, error, weight, angles, low, high)
        if np.abs(step).max(initial=0.0) < _DONE:
            break
        angles = np.clip(angles + step, low, high)
    place, turn, _, _ = _forward(links, best, base)
    missed = qa.to_rotvec(qa.mul(goal[1], qa.conj(turn)))
    return Solved(
        angles=best,
        off=np.linalg.norm(goal[0] - place, axis=-1),
        turned_off=np.linalg.norm(missed, axis=-1),
    )


def _forward(
    links: tuple[Link, ...], angles: Array, base: tuple[Array, Array]
) -> tuple[Array, Array, Array, Array]:
    """Place and rotation of the end, and all hinges' axes and anchors (N, H, 3), world."""
    place, turn = base
    axes = np.zeros((*angles.shape, 3))
    anchors = np.zeros((*angles.shape, 3))
    for link in links:
        place = place + qa.rotate(turn, link.offset)
        turn = qa.mul(turn, link.turn)
        for hinge in link.hinges:
            anchor = place + qa.rotate(turn, hinge.anchor)
            axes[:, hinge.column] = qa.rotate(turn, hinge.axis)
            anchors[:, hinge.column] = anchor
            turn = qa.mul(turn, qa.about(hinge.axis, angles[:, hinge.column] - hinge.zero))
            place = anchor - qa.rotate(turn, hinge.anchor)
    return place, turn, axes, anchors


def _step(
    axes: Array, arms: Array, error: Array, weight: float, angles: Array, low: Array, high: Array
) -> Array:
    """(N, H) the damped step; angles at a limit that it would pass stay."""
    jacobian = np.concatenate([np.cross(axes, arms), weight * axes], axis=-1)  # (N, H, 6)
    step = _solved(jacobian, error)
    stuck = ((angles <= low) & (step < 0.0)) | ((angles >= high) & (step > 0.0))
    if stuck.any():
        step = _solved(np.where(stuck[..., None], 0.0, jacobian), error)
    largest = np.abs(step).max(axis=-1, keepdims=True, initial=0.0)
    return step * np.minimum(1.0, _LARGEST_STEP / np.maximum(largest, 1e-30))


def _solved(jacobian: Array, error: Array) -> Array:
    squares = np.einsum("nhi,nki->nhk", jacobian, jacobian)
    pull = np.einsum("nhi,ni->nh", jacobian, error)
    size = np.maximum(np.einsum("nhh->nh", squares).max(axis=-1, initial=0.0), 1e-12)
    damped = squares + (_DAMPING * size)[:, None, None] * np.eye(jacobian.shape[1])
    return np.linalg.solve(damped, pull[..., None])[..., 0]
