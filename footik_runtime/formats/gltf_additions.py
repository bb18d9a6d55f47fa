"""Additions to a glTF file: what is new is appended, so that nothing that is there ever moves.

Earlier additions of ours that nothing needs any longer make room: cleaning again grows no file.
"""

from __future__ import annotations

import base64
import copy
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from footik_runtime.errors import FootIKError
from footik_runtime.files import make_folder, write_whole
from footik_runtime.formats.glb_container import (
    BIN_CHUNK,
    FLOAT,
    Gltf,
    dumped,
    pack_glb,
    read_bytes,
)
from footik_runtime.formats.gltf_own import OWN, OwnTail, own_tail, references
from footik_runtime.formats.gltf_tree import THEIRS, THEIRS_TURN, placed

Array = NDArray[np.float64]

EMBEDDED = "data:application/octet-stream;base64,"
_KINDS = {1: "SCALAR", 3: "VEC3", 4: "VEC4"}


class Additions:
    """A file and what shall be added to it. The file itself is not touched.

    Lists and objects of the document are copied when first changed, the rest is shared.
    """

    def __init__(self, gltf: Gltf) -> None:
        self.gltf = gltf
        self.document: dict[str, Any] = dict(gltf.json)
        self._animations: dict[int, dict[str, Any]] = {}
        self._data = bytearray()
        self._copied: set[str] = set()
        self._replaced: OwnTail | None = None  # earlier additions, of which some are dropped

    @property
    def empty(self) -> bool:
        """Nothing was added or changed."""
        return not self._copied

    def _list(self, kind: str) -> list[Any]:
        """A list of the document that may be changed; its objects are still shared."""
        if kind not in self._copied:
            self._copied.add(kind)
            self.document[kind] = list(self.gltf.items(kind))
        return self.document[kind]

    def animation(self, index: int) -> dict[str, Any]:
        """An animation that may be changed."""
        held = self._list("animations")
        if index not in self._animations:
            held[index] = self._animations[index] = copy.deepcopy(held[index])
        return held[index]

    def without_matrix(self, index: int) -> None:
        """Make a node's matrix the translation, rotation and scale it stands for.

        A node that is animated may have no matrix (section 3.5.3).
        """
        if "matrix" not in self.gltf.item("nodes", index):
            return
        move, turn, scale = placed(self.gltf, index)
        nodes = self._list("nodes")
        nodes[index] = {k: v for k, v in nodes[index].items() if k != "matrix"} | {
            "translation": move[THEIRS].tolist(),
            "rotation": turn[THEIRS_TURN].tolist(),
            "scale": scale[THEIRS].tolist(),
        }

    def accessor(self, values: Array) -> int:
        """Append (K, width) numbers as float32 and say under which index; times get min and max."""
        with np.errstate(over="ignore"):
            single = np.ascontiguousarray(values, dtype="<f4")
        if not np.isfinite(single).all():
            raise FootIKError(
                f"{self.gltf.path.name}: a value is beyond what glTF's float32 holds."
            )
        views, accessors = self._list("bufferViews"), self._list("accessors")
        at = len(self._data)
        self._data += single.tobytes()
        # The buffer's index and place are known when the file is written.
        place = {"buffer": -1, "byteOffset": at, "byteLength": single.nbytes}
        views.append({"name": OWN, **place})
        owner: dict[str, Any] = {
            "name": OWN,
            "bufferView": len(views) - 1,
            "componentType": FLOAT,
            "count": len(single),
            "type": _KINDS[single.shape[1]],
        }
        if single.shape[1] == 1:
            if (np.diff(single[:, 0]) <= 0.0).any():
                raise FootIKError(
                    f"{self.gltf.path.name}: glTF's float32 cannot tell the frames apart; fewer "
                    "frames a second are needed."
                )
            owner |= {"min": [float(single[0, 0])], "max": [float(single[-1, 0])]}
        accessors.append(owner)
        return len(accessors) - 1

    def write(self, target: Path) -> None:
        """Write the file by its suffix; what a .gltf names is copied beside it first."""
        as_glb = target.suffix.lower() == ".glb"
        if self.empty and as_glb == self.gltf.is_glb:
            data = self.gltf.raw
        else:
            self._drop_unused()
            data = self._packed() if as_glb else self._text()
        self._copy_named(target, as_glb)
        write_whole(target, data)

    def _drop_unused(self) -> None:
        """Leave out earlier additions that no animation needs; the others go with the new ones."""
        tail = own_tail(self.gltf)
        if tail is None:
            return
        accessors, views = self._list("accessors"), self._list("bufferViews")
        count = len(self.gltf.items("accessors"))
        animations = self.document.get("animations", [])
        used = {sampler[end] for each in animations for sampler, end in references(each)}
        kept = [a for a in range(tail.accessor, count) if a in used]
        same = len(kept) == count - tail.accessor and not self._data
        if same or not (kept or self._data or tail.start):  # a buffer may not be empty
            return
        held, data = self.gltf.buffer(tail.buffer), bytearray()
        moved: list[tuple[dict[str, Any], dict[str, Any]]] = []
        for owner, view in ((accessors[a], views[a - tail.accessor + tail.view]) for a in kept):
            at = view["byteOffset"]
            moved.append((owner, {**view, "buffer": -1, "byteOffset": len(data)}))
            data += held[at : at + view["byteLength"]]
        new = zip(accessors[count:], views[len(self.gltf.items("bufferViews")) :], strict=True)
        moved += [(a, {**v, "byteOffset": len(data) + v["byteOffset"]}) for a, v in new]
        accessors[tail.accessor :] = [
            {**owner, "bufferView": tail.view + n} for n, (owner, _) in enumerate(moved)
        ]
        views[tail.view :] = [view for _, view in moved]
        self._data, self._replaced = data + self._data, tail
        numbers = [*kept, *range(count, count + len(moved) - len(kept))]
        self._renumber({old: tail.accessor + n for n, old in enumerate(numbers)})

    def _renumber(self, places: dict[int, int]) -> None:
        """Give the animations the new numbers of accessors (old -> new)."""
        for index, animation in enumerate(self.document.get("animations", [])):
            if any(sampler[end] in places for sampler, end in references(animation)):
                for sampler, end in references(self.animation(index)):
                    sampler[end] = places.get(sampler[end], sampler[end])

    def _buffers(self) -> list[Any]:
        """The file's buffers without earlier additions."""
        buffers, tail = list(self.gltf.items("buffers")), self._replaced
        if tail is None:
            return buffers
        owner = {**buffers[tail.buffer], "byteLength": tail.start}
        if "uri" in owner:
            if not tail.start:
                return buffers[:-1]
            owner["uri"] = _embedded(self._bytes(tail.buffer))
        buffers[tail.buffer] = owner
        return buffers

    def _bytes(self, index: int) -> memoryview:
        """A buffer's bytes without earlier additions."""
        held, tail = self.gltf.buffer(index), self._replaced
        return held if tail is None or tail.buffer != index else held[: tail.start]

    def _packed(self) -> bytes:
        chunks, buffers = list(self.gltf.chunks), self._buffers()
        if not self.gltf.is_glb and buffers:
            chunks = [(BIN_CHUNK, self._bytes(0))]
            buffers[0] = {k: v for k, v in buffers[0].items() if k != "uri"}
        if not buffers or "uri" not in buffers[0]:
            # Further buffers may not lie in the chunk: what is new goes on where buffer 0 ends.
            held = self._bytes(0) if buffers else memoryview(b"")
            start = -(-len(held) // 4) * 4
            if self._data or self._replaced:
                whole = bytes(held) + bytes(start - len(held)) + bytes(self._data)
                buffers[:1] = [{**(buffers[0] if buffers else {}), "byteLength": len(whole)}]
                rest = [chunk for chunk in chunks if chunk[0] != BIN_CHUNK]
                chunks = [(BIN_CHUNK, memoryview(whole)), *rest]
            return pack_glb(self._placed_at(buffers, 0, start), chunks)
        return pack_glb(self._with_buffer(buffers), chunks)

    def _text(self) -> bytes:
        buffers = self._buffers()
        if self.gltf.is_glb and buffers and "uri" not in buffers[0]:
            buffers[0] = {**buffers[0], "uri": _embedded(self._bytes(0))}
        return dumped(self._with_buffer(buffers), indent=1)

    def _with_buffer(self, buffers: list[Any]) -> dict[str, Any]:
        """The document with the new data as a buffer of its own, in the text."""
        at = len(buffers)
        if self._data:
            buffers.append({"byteLength": len(self._data), "uri": _embedded(self._data)})
        return self._placed_at(buffers, at, 0)

    def _placed_at(self, buffers: list[Any], index: int, start: int) -> dict[str, Any]:
        document = dict(self.document)
        if buffers:
            document["buffers"] = buffers
        if "bufferViews" in document:
            document["bufferViews"] = [
                {**view, "buffer": index, "byteOffset": start + view["byteOffset"]}
                if isinstance(view, dict) and view.get("buffer") == -1
                else view
                for view in document["bufferViews"]
            ]
        return document

    def _copy_named(self, target: Path, as_glb: bool) -> None:
        """Copy the files that the document names to where the new document will look for them."""
        for found, copied in copies(self.gltf, target, as_glb=as_glb):
            make_folder(copied.parent)
            write_whole(copied, read_bytes(found))


def copies(gltf: Gltf, target: Path, *, as_glb: bool) -> list[tuple[Path, Path]]:
    """Each file that the document names, and where it will look for it when it is at `target`.

    None where that is the same place, or the data goes into a GLB.
    """
    folders = [gltf.path.absolute().parent, target.absolute().parent]
    if folders[0] == folders[1] or os.path.realpath(folders[0]) == os.path.realpath(folders[1]):
        return []
    return [
        (found, folders[1] / found.relative_to(gltf.path.parent))
        for kind, n, found in named_files(gltf)
        if not (kind == "buffers" and n == 0 and as_glb and not gltf.is_glb)
    ]


def named_files(gltf: Gltf) -> Iterator[tuple[str, int, Path]]:
    """The files that the document names: of "buffers" or "images", and which."""
    for kind in ("buffers", "images"):
        for n in range(len(gltf.items(kind))):
            uri = gltf.item(kind, n).get("uri")
            if isinstance(uri, str) and not uri.startswith("data:"):
                yield kind, n, gltf.beside(uri, f"{kind}[{n}]")


def _embedded(data: bytes | bytearray | memoryview) -> str:
    return EMBEDDED + base64.b64encode(data).decode("ascii")
