"""Curve exports: what Unity and Unreal import. Nothing reads these back.

Unity's keys carry slopes, so that few of them are exact; Unreal's tables hold values alone, and get
a key a frame, to be imported with linear interpolation.

Layouts. Unity: the manual's "Animation curves on imported clips" (docs.unity3d.com/Manual/
AnimationCurvesOnImportedClips.html): time runs from 0 to 1 over the clip, and a curve drives the
Animator parameter of its name; the scripting reference's ClipAnimationInfoCurve (name, curve) and
Keyframe (inTangent, outTangent a second; infinite ones hold the value). In an .anim that parameter
is an attribute of class 95, the Animator, at the empty path; written is the text layout of Unity
2018 to 2021 (clip version 6), which later ones upgrade. Unreal: "Data driven gameplay elements"
(dev.epicgames.com) for curve tables: x in the first row, after a cell that is not read, then a row
a curve, its name first; interpolation is chosen once for the table on import. A single curve is
imported from rows of time and value (CSVImportType.ECSV_CURVE_FLOAT).
"""

from __future__ import annotations

import csv
import io
import json
import math
import os
import re
from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from footik_runtime.clip import Clip
from footik_runtime.errors import FootIKError, unknown_name
from footik_runtime.files import unique_parts, write_whole
from footik_runtime.offline.curve_files import csv_text
from footik_runtime.offline.curve_keys import Keys, keys_of

Array = NDArray[np.float64]

EXPORTS = ("unity", "unity-meta", "unreal", "csv")
"""unity: an AnimationClip. unity-meta: curves for a model importer's clip. unreal: a curve table,
and a file a curve. csv: a row a frame."""

_ENDINGS = {
    "unity": ".anim",
    "unity-meta": ".meta.yaml",
    "unreal": ".curve_table.csv",
    "csv": ".curves.csv",
}
_TABLES = (".curves.csv", ".curve_table.csv", ".curve.csv")
_PLAIN = re.compile(r"[A-Za-z_][A-Za-z0-9_]*(?: [A-Za-z0-9_]+)*\Z")
_WORDS = {"y", "n", "yes", "no", "on", "off", "true", "false", "null"}
_THIRD = "0.33333334"
# Of both sides of a key, as Unity's editor keeps them: free, linear and constant tangents.
_TANGENT_MODES = {"smooth": 0, "linear": 69, "step": 103}


def export_curves(
    path: str | os.PathLike[str], clip: Clip, kind: str, *, tolerance: float = 0.005
) -> list[Path]:
    """Write the clip's curves for an engine beside `path`, named after it; returns those files.

    Args:
        path: of the clip's file, such as out/walk.bvh: gives walk.anim, walk.meta.yaml,
            walk.curve_table.csv with walk.NAME.curve.csv, or walk.curves.csv.
        clip: with at least one curve.
        kind: one of `EXPORTS`.
        tolerance: largest error of the keys of curves that have none of their own.

    Raises:
        FootIKError: an unknown kind, a clip without curves, a file that cannot be written.
    """
    require_export(kind)
    require_curves(clip)
    targets = export_files(path, clip.curves, kind)
    for target, text in zip(targets, _texts(clip, kind, tolerance), strict=True):
        write_whole(target, text.encode("utf-8", "replace"))
    return targets


def export_files(path: str | os.PathLike[str], curves: Iterable[str], kind: str) -> list[Path]:
    """The files that `export_curves` writes for a clip with curves of these names."""
    endings = [_ENDINGS[kind]]
    if kind == "unreal":
        endings += [f".{part}.curve.csv" for part in unique_parts(curves)]
    stem = Path(path).with_suffix("")
    return [stem.with_name(stem.name + ending) for ending in endings]


def is_export(path: Path) -> bool:
    """Whether a file is an export by its name: a .csv that holds curves, not a clip."""
    return path.name.lower().endswith(_TABLES)


def require_curves(clip: Clip) -> None:
    """Raise FootIKError for a clip without curves."""
    if not clip.curves:
        raise FootIKError(f"{clip.name}: has no curves to export; bake them first.")


def require_export(kind: str) -> None:
    """Raise FootIKError for a kind that is none of `EXPORTS`."""
    if kind not in EXPORTS:
        raise unknown_name("export", kind, EXPORTS)


def _texts(clip: Clip, kind: str, tolerance: float) -> Iterator[str]:
    if kind == "unity":
        yield unity_clip(clip, tolerance)
    elif kind == "unity-meta":
        yield unity_meta(clip, tolerance)
    elif kind == "csv":
        yield csv_text(clip)
    else:
        yield unreal_table(clip)
        for name in clip.curves:
            yield unreal_curve(clip, name)


# --- Unity --------------------------------------------------------------------------------------


def unity_clip(clip: Clip, tolerance: float = 0.005) -> str:
    """An AnimationClip (.anim) whose curves drive Animator parameters of their names."""
    floats = "".join(
        "  - curve:\n"
        + _unity_curve(keys_of(clip, name, tolerance), 6)
        + f"    attribute: {_yaml(name)}\n    path: \n    classID: 95\n"
        "    script: {fileID: 0}\n"
        for name in clip.curves
    )
    return (
        "%YAML 1.1\n%TAG !u! tag:unity3d.com,2011:\n--- !u!74 &7400000\nAnimationClip:\n"
        "  m_ObjectHideFlags: 0\n  m_CorrespondingSourceObject: {fileID: 0}\n"
        "  m_PrefabInstance: {fileID: 0}\n  m_PrefabAsset: {fileID: 0}\n"
        f"  m_Name: {_yaml(clip.name)}\n  serializedVersion: 6\n  m_Legacy: 0\n"
        "  m_Compressed: 0\n  m_UseHighQualityCurve: 1\n  m_RotationCurves: []\n"
        "  m_CompressedRotationCurves: []\n  m_EulerCurves: []\n  m_PositionCurves: []\n"
        f"  m_ScaleCurves: []\n  m_FloatCurves:\n{floats}  m_PPtrCurves: []\n"
        f"  m_SampleRate: {_number(clip.fps)}\n  m_WrapMode: 0\n  m_Bounds:\n"
        "    m_Center: {x: 0, y: 0, z: 0}\n    m_Extent: {x: 0, y: 0, z: 0}\n"
        "  m_ClipBindingConstant:\n    genericBindings: []\n    pptrCurveMapping: []\n"
        "  m_AnimationClipSettings:\n    serializedVersion: 2\n"
        "    m_AdditiveReferencePoseClip: {fileID: 0}\n    m_AdditiveReferencePoseTime: 0\n"
        f"    m_StartTime: 0\n    m_StopTime: {_number(clip.duration)}\n"
        "    m_OrientationOffsetY: 0\n    m_Level: 0\n    m_CycleOffset: 0\n"
        f"    m_HasAdditiveReferencePose: 0\n    m_LoopTime: {int(clip.loop)}\n"
        "    m_LoopBlend: 0\n    m_LoopBlendOrientation: 0\n    m_LoopBlendPositionY: 0\n"
        "    m_LoopBlendPositionXZ: 0\n    m_KeepOriginalOrientation: 0\n"
        "    m_KeepOriginalPositionY: 1\n    m_KeepOriginalPositionXZ: 0\n"
        "    m_HeightFromFeet: 0\n    m_Mirror: 0\n  m_EditorCurves: []\n"
        "  m_EulerEditorCurves: []\n  m_HasGenericRootTransform: 0\n"
        "  m_HasMotionFloatCurves: 0\n  m_Events: []\n"
    )


def unity_meta(clip: Clip, tolerance: float = 0.005) -> str:
    """The `curves` of an entry of `clipAnimations` in a model's .meta file: time is 0 to 1.

    It goes in place of that entry's `curves: []`.
    """
    length = clip.duration or 1.0
    curves = "".join(
        f"      - name: {_yaml(name)}\n        curve:\n"
        + _unity_curve(_normalised(keys_of(clip, name, tolerance), length), 10)
        for name in clip.curves
    )
    return f"      curves:\n{curves}"


def _normalised(keys: Keys, length: float) -> Keys:
    return Keys(
        times=keys.times / length,
        values=keys.values,
        slopes=keys.slopes * length,
        interpolation=keys.interpolation,
    )


def _unity_curve(keys: Keys, indent: int) -> str:
    """An AnimationCurve as YAML, `indent` spaces deep."""
    entering, leaving = _slopes(keys)
    lines = ["serializedVersion: 2", "m_Curve:"]
    for row in zip(keys.times, keys.values, entering, leaving, strict=True):
        time, value, before, after = (_number(x) for x in row)
        lines += [
            "- serializedVersion: 3",
            f"  time: {time}",
            f"  value: {value}",
            f"  inSlope: {before}",
            f"  outSlope: {after}",
            f"  tangentMode: {_TANGENT_MODES[keys.interpolation]}",
            "  weightedMode: 0",
            f"  inWeight: {_THIRD}",
            f"  outWeight: {_THIRD}",
        ]
    lines += ["m_PreInfinity: 2", "m_PostInfinity: 2", "m_RotationOrder: 4"]
    return "".join(" " * indent + line + "\n" for line in lines)


def _slopes(keys: Keys) -> tuple[Array, Array]:
    """(K,) slopes that enter and leave each key; infinite ones make Unity's constant steps."""
    if keys.interpolation == "smooth":
        return keys.slopes, keys.slopes
    if keys.interpolation == "step":
        return np.full(len(keys), math.inf), np.full(len(keys), math.inf)
    lines = np.diff(keys.values) / np.diff(keys.times)
    first, last = lines[:1], lines[-1:]
    if len(keys) == 1:
        first = last = np.zeros(1)
    return np.concatenate([first, lines]), np.concatenate([lines, last])


def _number(value: float) -> str:
    """Seven digits and more: Unity reads float32."""
    if math.isinf(value):
        return "Infinity" if value > 0 else "-Infinity"
    return f"{value:.9g}"


def _yaml(name: str) -> str:
    """A plain scalar where that is safe, else quoted; JSON's strings are YAML's."""
    if _PLAIN.match(name) and name.lower() not in _WORDS:
        return name
    return json.dumps(name)


# --- Unreal -------------------------------------------------------------------------------------


def unreal_table(clip: Clip) -> str:
    """A curve table: the times in the first row after its name, then a row a curve; linear."""
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(["Name", *(f"{t:.9g}" for t in clip.times)])
    for name, values in clip.curves.items():
        writer.writerow([name, *(f"{v:.9g}" for v in np.asarray(values))])
    return out.getvalue()


def unreal_curve(clip: Clip, name: str) -> str:
    """One float curve: a row of time and value a frame, without a header."""
    values = np.asarray(clip.curves[name])
    return "".join(f"{t:.9g},{v:.9g}\n" for t, v in zip(clip.times, values, strict=True))
