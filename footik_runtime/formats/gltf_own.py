"""What this library added to a glTF file before: found again, so that it is replaced, not repeated.

Additions are one run at the end of the accessors, of the buffer views and of the bytes of one
buffer, and bear a name. Where another tool has rearranged any of that, they are its own by now.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from footik_runtime.formats.glb_container import Gltf

OWN = "footik"
"""The name of the accessors and buffer views that are added."""


@dataclass(frozen=True, kw_only=True)
class OwnTail:
    """Where the additions begin: in the accessors, the buffer views, and the bytes of a buffer."""

    accessor: int
    view: int
    buffer: int
    start: int


def own_tail(gltf: Gltf) -> OwnTail | None:
    """The additions that end a file, None where there are none."""
    accessors, views = gltf.items("accessors"), gltf.items("bufferViews")
    count = 0
    for owner, view in zip(reversed(accessors), reversed(views), strict=False):
        if not (_is_own(owner) and _is_own(view)):
            break
        if owner.get("bufferView") != len(views) - 1 - count or "byteOffset" in owner:
            break
        count += 1
    if not count:
        return None
    first = views[-count]
    buffer, start = first.get("buffer"), first.get("byteOffset")
    end: Any = start
    for view in views[-count:]:
        if view.get("buffer") != buffer or view.get("byteOffset") != end or not _is_size(end):
            return None
        length = view.get("byteLength")
        if not _is_size(length):
            return None
        end += length
    if not _ends(gltf, buffer, end):
        return None
    return OwnTail(
        accessor=len(accessors) - count, view=len(views) - count, buffer=buffer, start=start
    )


def references(animation: Any) -> Iterator[tuple[dict[str, Any], str]]:
    """(sampler, "input" or "output") that name an accessor; nothing else refers to additions."""
    held = animation.get("samplers") if isinstance(animation, dict) else None
    for sampler in held if isinstance(held, list) else []:
        for end in ("input", "output"):
            if isinstance(sampler, dict) and type(sampler.get(end)) is int:
                yield sampler, end


def _ends(gltf: Gltf, index: Any, end: int) -> bool:
    """Whether a buffer ends there, and may be written anew without touching any other file."""
    buffers = gltf.items("buffers")
    if not _is_size(index) or index >= len(buffers) or not isinstance(buffers[index], dict):
        return False
    uri = buffers[index].get("uri")
    if uri is None:
        free = gltf.is_glb and index == 0
    else:
        free = isinstance(uri, str) and uri.startswith("data:") and index == len(buffers) - 1
    return free and buffers[index].get("byteLength") == end


def _is_own(owner: Any) -> bool:
    return isinstance(owner, dict) and owner.get("name") == OWN


def _is_size(value: Any) -> bool:
    return type(value) is int and value >= 0
