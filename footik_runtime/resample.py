"""The same run at another frame rate.

Slip a frame, raw accelerations and the like depend on the frame rate, so every run is brought to
one rate before it is scored. Motion is interpolated by cubics; feet are interpolated in the frame
of the ground they stand on, with a corner where a lock begins or ends, so that a foot that is
still in its recorded frames is still between them; flags never claim a contact that only one
neighbour has.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from footik_runtime.errors import FootIKError
from footik_runtime.quat_arrays import conj, rotate
from footik_runtime.recorded import BETWEEN_BODIES, SWING, Array, Bools, Ints, Run

GroundHeight = Callable[[Array, Array], ArrayLike]


@dataclass(frozen=True, kw_only=True, eq=False)
class _Grid:
    """Where M new times lie among T old ones: at `part` in [0, 1) of the way past frame `left`."""

    times: Array
    at: Array
    left: Ints
    part: Array

    @property
    def right(self) -> Ints:
        """The frame after each new time; `left` itself where that is the very frame."""
        return np.where(self.part > 0.0, self.left + 1, self.left)

    @property
    def nearest(self) -> Ints:
        return np.where(self.part < 0.5, self.left, self.right)

    def weights(self, ndim: int) -> Array:
        return self.part.reshape((-1,) + (1,) * (ndim - 1))


def resample(run: Run, fps: float = 120.0, *, ground_height: GroundHeight | None = None) -> Run:
    """The run at `fps`, from its first time to its last.

    Points and rotations are interpolated by cubics, exact at recorded frames. A new frame between
    two old ones is in contact (or locked) where both are, and takes the earlier one's phase; its
    pin is -1 where theirs differ.

    Args:
        run: what was recorded, at any rate, even or not.
        fps: frames a second wanted.
        ground_height: (points (N, 3), times (N,)) -> (N,) terrain heights, NaN where there is
            none: asked again for the new sole points, because terrain has edges. Without it,
            heights are interpolated linearly.

    Raises:
        FootIKError: fps is not positive, or `ground_height` answers with another shape.
    """
    if not (np.isfinite(fps) and fps > 0):
        raise FootIKError(f"the rate to resample to must be positive and finite, not {fps}.")
    if len(run) < 2 or np.allclose(np.diff(run.times) * fps, 1.0, rtol=0.0, atol=1e-6):
        return replace(run, fps=float(fps))
    grid = _grid(run.times, fps)
    bodies, soles = _resampled_feet(run, grid)
    return replace(
        run,
        fps=float(fps),
        times=grid.at,
        hips=_cubic(grid, run.hips),
        leg_rotations=_cubic_rotations(grid, run.leg_rotations),
        **soles,
        ground=_resampled_ground(run, grid, soles["sole"], ground_height),
        phase=run.phase_at(grid.at) if run.phase_at else _resampled_phase(grid, run.phase),
        locked=None if run.locked is None else run.locked[grid.left] & run.locked[grid.right],
        pin=_where_same(grid, run.pin, -1),
        **bodies,
        joints=None if run.joints is None else _cubic(grid, run.joints),
        stretch=None if run.stretch is None else _linear(grid, run.stretch),
    )


def _grid(times: Array, fps: float) -> _Grid:
    count = int(np.floor((times[-1] - times[0]) * fps + 1e-6)) + 1
    at = times[0] + np.arange(count) / fps
    left = np.clip(np.searchsorted(times, at, side="right") - 1, 0, len(times) - 2)
    part = (at - times[left]) / (times[left + 1] - times[left])
    # On a recorded frame, rounding must not bring in its neighbour's flags.
    left, part = np.where(part > 1 - 1e-6, left + 1, left), np.where(part > 1 - 1e-6, 0.0, part)
    return _Grid(times=times, at=at, left=left, part=np.where(part < 1e-6, 0.0, part))


def _linear(grid: _Grid, values: Array) -> Array:
    part = grid.weights(values.ndim)
    return values[grid.left] * (1.0 - part) + values[grid.right] * part


def _cubic(grid: _Grid, values: Array, corners: Bools | None = None) -> Array:
    """Cubic interpolation, (T, ...) to (M, ...).

    The spline of continuous acceleration, so that third differences are the motion's own. With
    `corners` (T, legs): cubics through parabola tangents, which no frame beyond the next can
    disturb, and a sharp bend at each corner, straight on both sides.
    """
    spans = np.diff(grid.times).reshape((-1,) + (1,) * (values.ndim - 1))
    slopes = np.diff(values, axis=0) / spans
    leaving = arriving = _parabola_tangents(spans, slopes)
    if corners is None:
        leaving = arriving = _spline_tangents(spans, slopes, leaving)
    else:
        corner = corners.reshape(corners.shape + (1,) * (values.ndim - corners.ndim))
        leaving = np.where(corner, np.concatenate([slopes, slopes[-1:]]), leaving)
        arriving = np.where(corner, np.concatenate([slopes[:1], slopes]), arriving)
    left, right, u = grid.left, grid.right, grid.weights(values.ndim)
    span = np.concatenate([spans, spans[-1:]])[left]
    # Written as a departure from the left frame, so that a constant stays one to the last bit.
    step = values[right] - values[left]
    blend = u * u * (3.0 - 2.0 * u)
    bend = leaving[left] * (u * (1.0 - u) ** 2) - arriving[right] * (u * u * (1.0 - u))
    return values[left] + blend * step + span * bend


def _parabola_tangents(spans: Array, slopes: Array) -> Array:
    """(T, ...) tangents of the parabola through each frame and its neighbours."""
    inner = (spans[1:] * slopes[:-1] + spans[:-1] * slopes[1:]) / (spans[1:] + spans[:-1])
    if len(inner) == 0:
        return np.concatenate([slopes, slopes])
    return np.concatenate([2.0 * slopes[:1] - inner[:1], inner, 2.0 * slopes[-1:] - inner[-1:]])


def _spline_tangents(spans: Array, slopes: Array, ends: Array) -> Array:
    """(T, ...) tangents that make acceleration continuous, with the first and last of `ends`.

    The tridiagonal system a[k-1] t[k-1] + 2 (a[k-1] + a[k]) t[k] + a[k] t[k+1] = right[k] with
    a = 1 / span, solved by elimination.
    """
    tangents = ends.copy()
    a = 1.0 / spans
    right = 3.0 * (slopes[:-1] * a[:-1] + slopes[1:] * a[1:])
    factors = np.zeros_like(a)
    for k in range(1, len(tangents) - 1):
        pivot = 2.0 * (a[k - 1] + a[k]) - a[k - 1] * factors[k - 1]
        factors[k] = a[k] / pivot
        tangents[k] = (right[k - 1] - a[k - 1] * tangents[k - 1]) / pivot
    for k in range(len(tangents) - 2, 0, -1):
        tangents[k] -= factors[k] * tangents[k + 1]
    return tangents


def _cubic_rotations(grid: _Grid, rotations: Array, corners: Bools | None = None) -> Array:
    turned = np.einsum("t...k,t...k->t...", rotations[1:], rotations[:-1]) < 0.0
    signs = np.cumprod(np.where(turned, -1.0, 1.0), axis=0)
    continuous = rotations.copy()
    continuous[1:] *= signs[..., None]
    mixed = _cubic(grid, continuous, corners)
    return mixed / np.maximum(np.linalg.norm(mixed, axis=-1, keepdims=True), 1e-12)


def _resampled_feet(run: Run, grid: _Grid) -> tuple[dict[str, NDArray], dict[str, NDArray]]:
    """Ground bodies, and the feet carried by them."""
    ids, places, turns = run.ground_ids, run.ground_positions, run.ground_rotations
    changes = _changes(ids)
    corners = changes | _lock_corners(run)
    one_body = (ids[grid.left] == ids[grid.right])[..., None]
    new_places = np.where(one_body, _cubic(grid, places, changes), places[grid.nearest])
    new_turns = np.where(one_body, _cubic_rotations(grid, turns, changes), turns[grid.nearest])
    feet = {}
    for name in ("ankle", "toe", "sole"):
        points = getattr(run, name)
        axes = (slice(None),) * 2 + (None,) * (points.ndim - 3)
        local = rotate(conj(turns[axes]), points - places[axes])
        carried = new_places[axes] + rotate(new_turns[axes], _cubic(grid, local, corners))
        # From one body to another there is no frame to ride in: cross in the world.
        feet[name] = np.where(one_body[axes], carried, _cubic(grid, points, corners))
    bodies = {
        "ground_positions": new_places,
        "ground_rotations": new_turns,
        "ground_ids": _where_same(grid, ids, BETWEEN_BODIES),
    }
    return bodies, feet


def _changes(values: NDArray) -> Bools:
    """Frames whose value differs from the one before or after."""
    differs = values[1:] != values[:-1]
    edge = np.zeros_like(values[:1], dtype=bool)
    return np.concatenate([edge, differs]) | np.concatenate([differs, edge])


def _lock_corners(run: Run) -> Bools:
    """Locked frames beside another lock state or pin: there motion may bend sharply."""
    if run.locked is None:
        return np.zeros(run.phase.shape, dtype=bool)
    return run.locked & _changes(np.where(run.locked, run.pin, -2))


def _resampled_phase(grid: _Grid, phase: Ints) -> Ints:
    return np.where(phase[grid.right] == SWING, SWING, phase[grid.left])


def _where_same(grid: _Grid, values: Ints, otherwise: int) -> Ints:
    before, after = values[grid.left], values[grid.right]
    return np.where(before == after, after, otherwise)


def _resampled_ground(
    run: Run, grid: _Grid, sole: Array, ground_height: GroundHeight | None
) -> Array:
    if ground_height is None:
        return _linear(grid, run.ground)
    times = np.broadcast_to(grid.at[:, None, None], sole.shape[:-1]).ravel()
    heights = np.asarray(ground_height(sole.reshape(-1, 3), times), dtype=np.float64)
    if heights.shape != times.shape:
        raise FootIKError(f"ground_height must return {times.shape} heights, not {heights.shape}.")
    return heights.reshape(sole.shape[:-1])
