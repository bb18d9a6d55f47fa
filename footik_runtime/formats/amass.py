"""AMASS: archives of SMPL poses, as a clip of a skeleton of average proportions.

Read are `poses` (T, 66, 72, 156 or 165) of rotation vectors, `trans` (T, 3) and the frame rate. The
file holds no skeleton, and the body models that fit its shape may not be passed on: ours has the
proportions of an average adult, scaled so that the feet come down to the floor z = 0. Its joints
have SMPL's names and axes, so rotations are exact.
"""

from __future__ import annotations

import math
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from footik_runtime import quat_arrays
from footik_runtime.clip import Clip
from footik_runtime.errors import FootIKError
from footik_runtime.formats.qpos_tables import read_table
from footik_runtime.skeleton import Skeleton

Array = NDArray[np.float64]

# Name, parent's name and offset from it: forward, left and up, m, for a leg of 0.85 m.
_BODY: tuple[tuple[str, str, tuple[float, float, float]], ...] = (
    ("Pelvis", "", (0.0, 0.0, 0.0)),
    ("L_Hip", "Pelvis", (-0.01, 0.065, -0.085)),
    ("R_Hip", "Pelvis", (-0.01, -0.065, -0.085)),
    ("Spine1", "Pelvis", (-0.03, 0.0, 0.115)),
    ("L_Knee", "L_Hip", (0.005, 0.04, -0.395)),
    ("R_Knee", "R_Hip", (0.005, -0.04, -0.395)),
    ("Spine2", "Spine1", (0.01, 0.0, 0.135)),
    ("L_Ankle", "L_Knee", (-0.035, -0.015, -0.41)),
    ("R_Ankle", "R_Knee", (-0.035, 0.015, -0.41)),
    ("Spine3", "Spine2", (0.0, 0.0, 0.055)),
    ("L_Foot", "L_Ankle", (0.125, 0.035, -0.055)),
    ("R_Foot", "R_Ankle", (0.125, -0.035, -0.055)),
    ("Neck", "Spine3", (-0.03, 0.0, 0.21)),
    ("L_Collar", "Spine3", (-0.02, 0.08, 0.115)),
    ("R_Collar", "Spine3", (-0.02, -0.08, 0.115)),
    ("Head", "Neck", (0.05, 0.0, 0.085)),
    ("L_Shoulder", "L_Collar", (-0.01, 0.11, 0.04)),
    ("R_Shoulder", "R_Collar", (-0.01, -0.11, 0.04)),
    ("L_Elbow", "L_Shoulder", (-0.02, 0.255, -0.015)),
    ("R_Elbow", "R_Shoulder", (-0.02, -0.255, -0.015)),
    ("L_Wrist", "L_Elbow", (0.0, 0.25, 0.01)),
    ("R_Wrist", "R_Elbow", (0.0, -0.25, 0.01)),
)
_FINGERS = ("Index", "Middle", "Pinky", "Ring", "Thumb")
_FINGER_AT = {"Index": 0.02, "Middle": 0.0, "Pinky": -0.045, "Ring": -0.025, "Thumb": 0.035}
_FACE = (("Jaw", (0.02, 0.0, 0.01)), ("L_Eye", (0.06, 0.03, 0.06)), ("R_Eye", (0.06, -0.03, 0.06)))
_RATES = ("mocap_framerate", "mocap_frame_rate", "fps", "framerate")
LARGEST_VALUE = 1e15
"""m or rad: whatever is beyond was never measured, and its square may overflow."""
_SOLE = 0.02  # m from the foot joint down to the ground
_ON_FLOOR = 0.1  # quantile of the frames in which a foot is as low as it comes
_SIZES = (0.5, 1.6)  # of the body, times the average


def read_amass(path: str | os.PathLike[str]) -> Clip:
    """Read an archive of SMPL, SMPL-H or SMPL-X poses.

    Returns the clip, z up as the file; `extras["notes"]` tells what was assumed. Raises FootIKError
    for what is no such archive.
    """
    return clip_of(read_table(path).arrays, path)


def is_amass(arrays: Mapping[str, NDArray[Any]]) -> bool:
    """Whether an archive's arrays are those of AMASS."""
    return "poses" in arrays and "trans" in arrays


def clip_of(arrays: Mapping[str, NDArray[Any]], path: str | os.PathLike[str]) -> Clip:
    """The clip of an archive's arrays, as `read_amass` reads them."""
    for name in ("poses", "trans"):
        if name not in arrays:
            raise FootIKError(
                f"{path}: the array {name} is missing; there are {', '.join(arrays)}."
            )
    poses, trans = (_numbers(arrays[name], name, path) for name in ("poses", "trans"))
    joints = _joints(poses, path)
    if trans.shape != (len(poses), 3) or len(poses) == 0:
        raise FootIKError(
            f"{path}: trans must be ({len(poses)}, 3) and hold a frame, not {trans.shape}."
        )
    turns = quat_arrays.from_rotvec(poses[:, : 3 * len(joints)].reshape(len(poses), -1, 3))
    # From SMPL's axes (left, up, forward) to ours, by turning x to y, y to z and z to x.
    rotations = turns[..., [0, 3, 1, 2]]
    to_smpl = np.array([0.5, -0.5, -0.5, -0.5])
    rotations[:, 0] = quat_arrays.mul(turns[:, 0], to_smpl)
    unit = _skeleton(joints, 1.0)
    size = _size(unit, rotations, trans)
    notes = [
        "AMASS holds no skeleton: this one has the proportions of an average adult, "
        f"{size:.2f} times as large, so that the feet come down to z = 0."
    ]
    return Clip(
        skeleton=_skeleton(joints, size),
        fps=_rate(arrays, path),
        root_positions=trans,
        rotations=rotations,
        name=Path(path).stem,
        extras={"notes": notes},
    )


def _numbers(value: NDArray[Any], name: str, path: Any) -> Array:
    numbers = value.astype(np.float64) if value.dtype.kind in "iuf" else np.full(1, np.nan)
    if not (np.abs(numbers) <= LARGEST_VALUE).all():
        raise FootIKError(
            f"{path}: the array {name} must hold finite numbers, none beyond {LARGEST_VALUE:g}."
        )
    return numbers


def _joints(poses: Array, path: str | os.PathLike[str]) -> list[tuple[str, str, Any]]:
    """Name, parent and offset of the joints that a row of poses turns, in its order."""
    body = list(_BODY)
    hands = [
        ("L_Hand", "L_Wrist", (-0.01, 0.085, -0.01)),
        ("R_Hand", "R_Wrist", (-0.01, -0.085, 0.0)),
    ]
    by_width = {72: body + hands, 66: body, 156: body + _hands()}
    by_width[165] = [*body, *[(name, "Head", at) for name, at in _FACE], *_hands()]
    width = poses.shape[-1] if poses.ndim == 2 else 0
    if width not in by_width:
        raise FootIKError(
            f"{path}: poses must be (T, n) with n one of {sorted(by_width)}, not {poses.shape}."
        )
    return by_width[width]


def _hands() -> list[tuple[str, str, Any]]:
    """The fingers of both hands, three joints each."""
    out: list[tuple[str, str, Any]] = []
    for side, left in (("L", 1.0), ("R", -1.0)):
        for finger in _FINGERS:
            parent, reach = f"{side}_Wrist", 0.05 if finger == "Thumb" else 0.1
            for joint in (1, 2, 3):
                at = (_FINGER_AT[finger] if joint == 1 else 0.0, left * reach, 0.0)
                out.append((f"{side}_{finger}{joint}", parent, at))
                parent, reach = f"{side}_{finger}{joint}", 0.03
    return out


def _skeleton(joints: list[tuple[str, str, Any]], size: float) -> Skeleton:
    names = tuple(name for name, _, _ in joints)
    return Skeleton(
        names=names,
        parents=np.array([names.index(p) if p else -1 for _, p, _ in joints], dtype=np.int32),
        offsets=size * np.array([at for _, _, at in joints]),
    )


def _size(unit: Skeleton, rotations: Array, trans: Array) -> float:
    """How large the body is, so that its feet touch the floor as often as feet do."""
    hung, _ = unit.forward(rotations, np.zeros_like(trans))
    feet = [unit.names.index(name) for name in ("L_Foot", "R_Foot", "L_Ankle", "R_Ankle")]
    down = _SOLE - hung[:, feet, 2].min(axis=1)
    known = down > 0.3
    if not known.any():
        return 1.0
    size = float(np.quantile(trans[known, 2] / down[known], _ON_FLOOR))
    return min(max(size, _SIZES[0]), _SIZES[1])


def _rate(arrays: Mapping[str, NDArray[Any]], path: str | os.PathLike[str]) -> float:
    for name in _RATES:
        value = arrays.get(name)
        if value is not None and value.size == 1 and value.dtype.kind in "iuf":
            rate = float(value.reshape(-1)[0])
            if math.isfinite(rate) and rate > 0.0:
                return rate
            raise FootIKError(f"{path}: {name} must be positive and finite, not {rate}.")
    raise FootIKError(f"{path}: the frame rate is missing: none of {', '.join(_RATES)}.")
