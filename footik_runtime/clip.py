"""Clip: frames of a skeleton at a fixed rate, with named curves; sampled by cubic interpolation."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from footik_runtime.compiled import compiled
from footik_runtime.errors import FootIKError
from footik_runtime.math3d import quat_unit, set4
from footik_runtime.skeleton import Skeleton

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, eq=False)
class Pose:
    """One pose: local joint rotations and the root's place.

    Attributes:
        root_position: (3,) of joint 0, m.
        rotations: (J, 4) local, wxyz.
        translations: (J, 3) local, m, or None where they are the skeleton's offsets.
        curves: value of each named curve.
    """

    root_position: Array
    rotations: Array
    translations: Array | None = None
    curves: dict[str, float] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True, eq=False)
class Clip:
    """T frames at `fps`; frame i is at i / fps seconds, so it lasts (T - 1) / fps seconds.

    Attributes:
        skeleton: the joints that move, J of them.
        fps: frames a second.
        root_positions: (T, 3) of joint 0, m, z up.
        rotations: (T, J, 4) local, wxyz, unit, made continuous in sign along time.
        translations: (T, J, 3) local, m, or None where they are the skeleton's offsets.
        curves: name -> (T,) values, such as IK weights.
        loop: the last frame is the first one again, a cycle later and a stride further on.
        name: what to call it in messages.
        extras: what a file format wants to find again when it writes the clip back.
    """

    skeleton: Skeleton
    fps: float
    root_positions: Array
    rotations: Array
    translations: Array | None = None
    curves: dict[str, Array] = field(default_factory=dict)
    loop: bool = False
    name: str = "clip"
    extras: dict[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        set_field = object.__setattr__
        joints = len(self.skeleton)
        frames = len(self.rotations)
        if not (np.isfinite(self.fps) and self.fps > 0):
            raise FootIKError(f"{self.name}: fps must be positive and finite, not {self.fps}.")
        if frames < 1:
            raise FootIKError(f"{self.name}: a clip needs at least one frame.")
        arrays = {"root_positions": (frames, 3), "rotations": (frames, joints, 4)}
        if self.translations is not None:
            arrays["translations"] = (frames, joints, 3)
        for attribute, shape in arrays.items():
            value = np.ascontiguousarray(getattr(self, attribute), dtype=np.float64)
            if value.shape != shape:
                raise FootIKError(f"{self.name}: {attribute} must be {shape}, not {value.shape}.")
            self._require_finite(attribute, value)
            set_field(self, attribute, value)
        for curve, values in self.curves.items():
            if np.shape(values) != (frames,):
                raise FootIKError(
                    f"{self.name}: curve {curve!r} must have {frames} values, "
                    f"not shape {np.shape(values)}."
                )
            self._require_finite(f"curve {curve!r}", np.asarray(values, dtype=np.float64))
        set_field(self, "rotations", _continuous(self.rotations, self.name))

    def _require_finite(self, what: str, value: Array) -> None:
        bad = np.argwhere(~np.isfinite(value))
        if len(bad):
            frame = bad[0][0]
            joint = f", joint {self.skeleton.names[bad[0][1]]!r}" if value.ndim == 3 else ""
            raise FootIKError(
                f"{self.name}: {what} is not finite at frame {frame}{joint} "
                f"({len(np.unique(bad[:, 0]))} of {len(value)} frames are bad)."
            )

    def __len__(self) -> int:
        return len(self.rotations)

    @property
    def duration(self) -> float:
        """Seconds from the first frame to the last."""
        return (len(self) - 1) / self.fps

    @property
    def times(self) -> Array:
        """(T,) seconds of each frame."""
        return np.arange(len(self)) / self.fps

    def with_curves(self, **curves: Array) -> Clip:
        """The same clip with these curves added or replaced."""
        return replace(self, curves={**self.curves, **curves})

    def cut(self, start: int, stop: int) -> Clip:
        """Frames start to stop - 1 as a clip of their own."""
        if not 0 <= start < stop <= len(self):
            raise FootIKError(
                f"{self.name}: cannot cut frames {start}:{stop} from a clip of {len(self)} frames."
            )
        return replace(
            self,
            root_positions=self.root_positions[start:stop],
            rotations=self.rotations[start:stop],
            translations=None if self.translations is None else self.translations[start:stop],
            curves={name: np.asarray(v)[start:stop] for name, v in self.curves.items()},
            loop=False,
        )

    def model_pose(self) -> tuple[Array, Array]:
        """Positions (T, J, 3) and rotations (T, J, 4) of all joints in the clip's own frame."""
        return self.skeleton.forward(self.rotations, self.root_positions, self.translations)


def _continuous(rotations: Array, name: str) -> Array:
    """Unit quaternions whose sign never jumps between frames, so that components interpolate."""
    lengths = np.linalg.norm(rotations, axis=-1, keepdims=True)
    if (lengths < 1e-6).any():
        frame, joint = np.argwhere(lengths[..., 0] < 1e-6)[0]
        raise FootIKError(f"{name}: rotation of joint {joint} at frame {frame} has zero length.")
    # Leave what is unit already to the last bit: reading and writing again must not drift.
    unit = np.where(np.abs(lengths - 1.0) < 1e-12, rotations, rotations / lengths)
    turned = np.einsum("tjk,tjk->tj", unit[1:], unit[:-1]) < 0.0
    flips = np.cumprod(np.where(turned, -1.0, 1.0), axis=0)
    unit[1:] *= flips[..., None]
    return np.ascontiguousarray(unit)
