"""File formats: each module reads and writes one Clip, and nothing else."""

from __future__ import annotations

import os
from pathlib import Path

from footik_runtime.clip import Clip
from footik_runtime.errors import FootIKError
from footik_runtime.files import remove, require_replaceable
from footik_runtime.formats import amass, npz
from footik_runtime.formats.bvh import BvhLayout, read_bvh, write_bvh
from footik_runtime.formats.gltf import animation_names, read_gltf
from footik_runtime.formats.gltf_write import write_gltf
from footik_runtime.formats.npz import read_npz, write_npz
from footik_runtime.formats.qpos import SOURCE as QPOS
from footik_runtime.formats.qpos import read_qpos, write_qpos
from footik_runtime.formats.qpos_tables import read_table
from footik_runtime.offline.curve_files import read_curves, sidecar, write_curves

__all__ = [
    "SUFFIXES",
    "BvhLayout",
    "animation_names",
    "load_clip",
    "read_bvh",
    "read_gltf",
    "read_npz",
    "read_qpos",
    "save_clip",
    "write_bvh",
    "write_gltf",
    "write_npz",
    "write_qpos",
]

SUFFIXES = (".bvh", ".glb", ".gltf", ".npz", ".csv")
"""Of the files that hold clips."""

_GLTF = (".glb", ".gltf")


def load_clip(
    path: str | os.PathLike[str],
    *,
    animation: str | None = None,
    model: str | os.PathLike[str] | None = None,
    fps: float | None = None,
) -> Clip:
    """Read a clip by its suffix.

    Args:
        path: .bvh, .glb, .gltf; .npz of ours, of AMASS or of joint values; .csv of joint values.
            BVH and joint values with their curves, where NAME.curves.json lies beside them.
        animation: name of the one to read from a .glb or .gltf; the first where None.
        model: MuJoCo model (XML) whose joint values an .npz or .csv holds.
        fps: frames a second of joint values and glTF, where the file does not tell.

    Raises:
        FootIKError: a file that nothing reads, is broken, or needs a model that is not given.
    """
    if os.path.isdir(path):
        raise FootIKError(f"{path}: is a folder, not a clip.")
    if not (Path(path).suffix or os.path.exists(path)):
        raise FootIKError(f"{path}: there is no such file.")
    suffix = _suffix(path)
    if suffix == ".bvh":
        return _with_sidecar(read_bvh(path), path)
    if suffix in _GLTF:
        return read_gltf(path, animation=animation, fps=fps)
    if model is not None:
        return _with_sidecar(read_qpos(path, model, fps=fps), path)
    if suffix == ".npz":
        arrays = read_table(path).arrays
        if amass.is_amass(arrays):
            return amass.clip_of(arrays, path)
        if "footik_clip" in arrays:
            return npz.clip_of(arrays, path)
    raise FootIKError(f"{path}: joint values need the MuJoCo model they belong to (--model XML).")


def save_clip(clip: Clip, path: str | os.PathLike[str]) -> None:
    """Write a clip by its suffix: .bvh, .glb, .gltf, .npz or .csv.

    An .npz or .csv of joint values stays one; the curves of these and of a .bvh go beside them, in
    place of those that lie there: a clip without curves takes them away.
    Raises FootIKError where it cannot be written.
    """
    suffix = _suffix(path)
    if suffix == ".bvh" or QPOS in clip.extras:  # before the motion changes
        require_replaceable(sidecar(path))
    if suffix == ".bvh":
        write_bvh(clip, path)
        _write_sidecar(clip, path)
    elif suffix in _GLTF:
        write_gltf(clip, path)
    elif QPOS in clip.extras:
        write_qpos(clip, path)
        _write_sidecar(clip, path)
    elif suffix == ".npz":
        write_npz(clip, path)
    else:
        raise FootIKError(f"{path}: only a clip that was read from joint values becomes a .csv.")


def _with_sidecar(clip: Clip, path: str | os.PathLike[str]) -> Clip:
    return read_curves(sidecar(path), clip) if sidecar(path).is_file() else clip


def _write_sidecar(clip: Clip, path: str | os.PathLike[str]) -> None:
    if clip.curves:
        write_curves(sidecar(path), clip)
    else:  # those of an earlier clip would be taken for this one's
        remove(sidecar(path))


def _suffix(path: str | os.PathLike[str]) -> str:
    suffix = Path(path).suffix.lower()
    if suffix not in SUFFIXES:
        raise FootIKError(
            f"{path}: cannot tell the format from the suffix {suffix!r}; "
            f"clips are {', '.join(SUFFIXES)}."
        )
    return suffix
