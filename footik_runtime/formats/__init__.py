"""File formats: each module reads and writes one Clip, and nothing else."""

from footik_runtime.formats.bvh import BvhLayout, read_bvh, write_bvh

__all__ = ["BvhLayout", "read_bvh", "write_bvh"]
