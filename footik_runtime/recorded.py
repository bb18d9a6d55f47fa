"""A recorded run: everything that is needed to measure it, as plain arrays."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from footik_runtime.errors import FootIKError, unknown_name

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]

SWING, HEEL, FLAT, BALL = range(4)
BETWEEN_BODIES = int(np.iinfo(np.int64).min)


@dataclass(frozen=True, kw_only=True, eq=False)
class Run:
    """T recorded frames of a character with L legs of K joints and P sole points a foot.

    Lengths in metres, world frame, z up; rotations wxyz. Everything is finite but `ground`.

    Attributes:
        fps: nominal frames a second.
        times: (T,) seconds, increasing.
        hips: (T, 3) the hips joint.
        leg_rotations: (T, L, K, 4) local rotations of hip, knee, ankle and, where K is 4, toe.
        ankle: (T, L, 3) the ankle joints.
        toe: (T, L, 3) the toe joints, where the toes bend.
        sole: (T, L, P, 3) points on the underside of each foot, as `sole_names` names them.
        ground: (T, L, P) terrain height under each sole point; NaN where there is none.
        phase: (T, L) the clip's contact: 0 swing, 1 heel, 2 flat, 3 ball.
        phases_known: False where `phase` tells contact only (any value but 0).
        locked: (T, L) whether a foot is held; None for a run that has no locks.
        pin: (T, L) index of the sole point that is held while locked, or -1; -1 by default.
        ground_positions: (T, L, 3) place of the body each foot stands on; zeros by default.
        ground_rotations: (T, L, 4) its rotation; identities by default.
        ground_ids: (T, L) which body that is; motion across a change is not measured, nor where it
            is BETWEEN_BODIES. Zeros by default.
        joints: (T, J, 3) all joints, for deviation and jitter, or None.
        stretch: (T, L) largest segment length of each leg over its rest length, less 1, or None.
        phase_at: times (N,) -> phases (N, L), where the clip tells them between frames too; asked
            when a run is resampled. Otherwise they are told from the frames beside.
        sole_names: what the sole points are; holds "heel" and "ball".
    """

    fps: float
    times: Array
    hips: Array
    leg_rotations: Array
    ankle: Array
    toe: Array
    sole: Array
    ground: Array
    phase: Ints
    phases_known: bool = True
    locked: Bools | None = None
    pin: Ints = field(default_factory=lambda: np.zeros(0, np.int64))
    ground_positions: Array = field(default_factory=lambda: np.zeros(0))
    ground_rotations: Array = field(default_factory=lambda: np.zeros(0))
    ground_ids: Ints = field(default_factory=lambda: np.zeros(0, np.int64))
    joints: Array | None = None
    stretch: Array | None = None
    phase_at: Callable[[Array], Ints] | None = None
    sole_names: tuple[str, ...] = ("heel", "ball", "tip")

    def __post_init__(self) -> None:
        if not (np.isfinite(self.fps) and self.fps > 0):
            raise FootIKError(f"a run's fps must be positive and finite, not {self.fps}.")
        frames, legs, points = len(np.atleast_1d(self.times)), *self._legs_and_points()
        if frames < 1:
            raise FootIKError("a run needs at least one frame.")
        self._set_default("ground_positions", np.zeros((frames, legs, 3)))
        self._set_default("ground_rotations", np.tile([1.0, 0.0, 0.0, 0.0], (frames, legs, 1)))
        self._set_default("ground_ids", np.zeros((frames, legs), np.int64))
        self._set_default("pin", np.full((frames, legs), -1, np.int64))
        for name, kind, shape in (
            ("times", np.float64, (frames,)),
            ("hips", np.float64, (frames, 3)),
            ("leg_rotations", np.float64, (frames, legs, None, 4)),
            ("ankle", np.float64, (frames, legs, 3)),
            ("toe", np.float64, (frames, legs, 3)),
            ("sole", np.float64, (frames, legs, points, 3)),
            ("ground", np.float64, (frames, legs, points)),
            ("phase", np.int64, (frames, legs)),
            ("locked", np.bool_, (frames, legs)),
            ("pin", np.int64, (frames, legs)),
            ("ground_positions", np.float64, (frames, legs, 3)),
            ("ground_rotations", np.float64, (frames, legs, 4)),
            ("ground_ids", np.int64, (frames, legs)),
            ("joints", np.float64, (frames, None, 3)),
            ("stretch", np.float64, (frames, legs)),
        ):
            self._require(name, kind, shape)
        if (np.diff(self.times) <= 0).any():
            frame = int(np.argmax(np.diff(self.times) <= 0)) + 1
            raise FootIKError(f"a run's times must increase; those of frame {frame} do not.")
        if ((self.pin < -1) | (self.pin >= points)).any():
            raise FootIKError(f"a run's pin must be -1 or a sole point from 0 to {points - 1}.")
        for name in ("heel", "ball"):
            self.point(name)

    def _legs_and_points(self) -> tuple[int, int]:
        shape = np.shape(self.sole)
        if len(shape) != 4 or shape[1] < 1 or shape[2] != len(self.sole_names) or shape[3] != 3:
            wanted = f"(frames, legs, {len(self.sole_names)}, 3)"
            raise FootIKError(f"a run's sole must be {wanted}, as its sole_names say, not {shape}.")
        return shape[1], shape[2]

    def _set_default(self, name: str, value: NDArray) -> None:
        if np.size(getattr(self, name)) == 0:
            object.__setattr__(self, name, value)

    def _require(self, name: str, kind: type, shape: tuple[int | None, ...]) -> None:
        given = getattr(self, name)
        if given is None:
            return
        value = np.ascontiguousarray(given, dtype=kind)
        wanted = tuple(
            n if want is None else want
            for want, n in zip(shape, value.shape + (0,) * len(shape), strict=False)
        )
        if value.shape != wanted:
            shown = ", ".join("any" if n is None else str(n) for n in shape)
            comma = "," if len(shape) == 1 else ""
            raise FootIKError(f"a run's {name} must be ({shown}{comma}), not {value.shape}.")
        if name != "ground" and not np.isfinite(value).all():
            frame = int(np.argwhere(~np.isfinite(value))[0, 0])
            raise FootIKError(f"a run's {name} is not finite at frame {frame}.")
        object.__setattr__(self, name, value)

    def __len__(self) -> int:
        return len(self.times)

    def point(self, name: str) -> int:
        """Index of a sole point by name. Raises FootIKError where the soles have none such."""
        if name not in self.sole_names:
            raise unknown_name("sole point", name, self.sole_names)
        return self.sole_names.index(name)

    @property
    def contact(self) -> Bools:
        """(T, L) whether each foot is in contact, in any phase."""
        return self.phase != SWING
