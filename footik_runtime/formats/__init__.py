"""File formats: each module reads and writes one Clip, and nothing else."""

from __future__ import annotations

import os
from pathlib import Path

from footik_runtime.clip import Clip
from footik_runtime.errors import FootIKError
from footik_runtime.formats.bvh import BvhLayout, read_bvh, write_bvh

__all__ = ["READERS", "BvhLayout", "load_clip", "read_bvh", "write_bvh"]

READERS = {".bvh": read_bvh}
"""File suffix -> what reads it."""


def load_clip(path: str | os.PathLike[str]) -> Clip:
    """Read a clip by its suffix. Raises FootIKError for one that nothing reads."""
    suffix = Path(path).suffix.lower()
    if suffix not in READERS:
        raise FootIKError(
            f"{path}: cannot tell the format from the suffix {suffix!r}; "
            f"these are read: {', '.join(READERS)}."
        )
    return READERS[suffix](path)
