"""glTF's outside: GLB chunks, buffers, accessors. What they hold is read elsewhere.

Every count and offset of a file is checked against the bytes there are before anything is
allocated, so that a broken file costs no more than it weighs. Format: Khronos, glTF 2.0, sections
3.6 (binary data) and 4.4 (GLB).
"""

from __future__ import annotations

import base64
import binascii
import json
import os
import struct
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NoReturn
from urllib.parse import unquote

import numpy as np
from numpy.typing import NDArray

from footik_runtime.errors import FootIKError

Array = NDArray[np.float64]

LARGEST_FILE = 1 << 30  # bytes
JSON_CHUNK, BIN_CHUNK = 0x4E4F534A, 0x004E4942
FLOAT = 5126
_KINDS = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", FLOAT: "<f4"}
_WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT4": 16}
_NAMES = {
    int: "a whole number",
    float: "a number",
    str: "a text",
    list: "a list",
    dict: "an object",
}


@dataclass(frozen=True, kw_only=True, eq=False)
class Gltf:
    """One glTF file as it stands.

    Attributes:
        path: where it was read from.
        json: its document.
        raw: all bytes of the file.
        chunks: (type, bytes) of a GLB after its JSON; empty for a .gltf.
        is_glb: a binary file, not a .gltf text.
    """

    path: Path
    json: dict[str, Any] = field(repr=False)
    raw: bytes = field(repr=False)
    chunks: tuple[tuple[int, memoryview], ...] = ()
    is_glb: bool = True
    _buffers: dict[int, memoryview] = field(default_factory=dict, repr=False)

    def fail(self, what: str) -> NoReturn:
        """Raise FootIKError: the file's name, and what is wrong with it."""
        raise FootIKError(f"{self.path.name}: {what}.")

    def items(self, kind: str) -> list[Any]:
        """A list at the top of the document, such as "nodes"; empty where there is none."""
        return self.get(self.json, kind, list, "the document", [])

    def item(self, kind: str, index: int) -> dict[str, Any]:
        """One object of such a list. Raises FootIKError for an index that it does not have."""
        held = self.items(kind)
        if not 0 <= index < len(held):
            self.fail(f"{kind}[{index}] is asked for, but the file has {len(held)} {kind}")
        if not isinstance(held[index], dict):
            self.fail(f"{kind}[{index}] must be an object")
        return held[index]

    def get(self, owner: Any, key: str, kind: type, where: str, default: Any = None) -> Any:
        """A member of an object, of a known type. No default means that it must be there."""
        if not isinstance(owner, dict):
            self.fail(f"{where} must be an object")
        value = owner.get(key)
        if value is None:
            if default is None:
                self.fail(f"{where} has no {key!r}")
            return default
        right = isinstance(value, (int, float) if kind is float else kind)
        if not right or isinstance(value, bool):
            self.fail(f"{key!r} of {where} must be {_NAMES[kind]}")
        return value

    def numbers(self, owner: Any, key: str, count: int, where: str) -> Array | None:
        """A list of `count` finite numbers, or None where the object has no such member."""
        if key not in owner:
            return None
        held = self.get(owner, key, list, where)
        good = len(held) == count and all(type(v) in (int, float) for v in held)
        # abs() also turns away integers that no float holds.
        if not good or not all(abs(v) < 1e38 for v in held):
            self.fail(f"{key!r} of {where} must be {count} finite numbers")
        return np.array(held, dtype=np.float64)

    def buffer(self, index: int) -> memoryview:
        """The bytes of one buffer."""
        if index not in self._buffers:
            self._buffers[index] = self._loaded(index)
        return self._buffers[index]

    def _loaded(self, index: int) -> memoryview:
        where = f"buffers[{index}]"
        owner = self.item("buffers", index)
        length = self.get(owner, "byteLength", int, where)
        if "uri" in owner:
            held = self._fetched(self.get(owner, "uri", str, where), where)
        elif index == 0 and self.is_glb:
            held = next((data for kind, data in self.chunks if kind == BIN_CHUNK), memoryview(b""))
        else:
            self.fail(f"{where} has neither a uri nor a binary chunk")
        if not 0 <= length <= len(held):
            self.fail(f"{where} tells of {length} bytes, but {len(held)} are there")
        return held[:length]

    def _fetched(self, uri: str, where: str) -> memoryview:
        if uri.startswith("data:"):
            head, comma, text = uri.partition(",")
            if not comma or not head.endswith(";base64"):
                self.fail(f"the data uri of {where} is not base64")
            try:
                return memoryview(base64.b64decode(text))
            except (binascii.Error, ValueError) as error:
                self.fail(f"the data uri of {where} is not base64: {error}")
        return memoryview(read_bytes(self.beside(uri, where)))

    def beside(self, uri: str, where: str) -> Path:
        """The path of a file that the document names: in its own folder or below, nowhere else."""
        name = unquote(uri)
        bad = ":" in name or "\\" in name or "\0" in name or name.startswith("/") or not name
        try:
            folder = self.path.absolute().parent.resolve()
            if not bad and (folder / name).resolve().is_relative_to(folder):
                return self.path.parent / name
        except (OSError, ValueError, RuntimeError):
            pass
        shown = uri if len(uri) < 60 else uri[:60] + "…"
        self.fail(f"{where} names {shown!r}; only files in the folder of the document are read")

    def accessor(self, index: int, kinds: Sequence[str], where: str) -> Array:
        """(count, width) values of an accessor, normalised integers as numbers.

        Args:
            index: which.
            kinds: the types it may have, such as ("VEC3",).
            where: what refers to it, for messages.
        """
        own = f"accessors[{index}]"
        owner = self.item("accessors", index)
        kind = self.get(owner, "type", str, own)
        if kind not in kinds:
            self.fail(f"{where} needs an accessor of {' or '.join(kinds)}; {own} is {kind[:20]!r}")
        count = self.get(owner, "count", int, own)
        width = _WIDTHS[kind]
        most = max(len(self.raw), 1 << 16) // 4
        dtype = self._dtype(owner, own)
        if "bufferView" in owner:
            found = self._elements(owner, count, width, dtype, own)
        elif 0 <= count * width <= most:
            found = np.zeros((count, width), dtype=dtype)
        else:
            self.fail(f"{own} tells of {count} elements that no buffer holds")
        if "sparse" in owner:
            found = self._with_sparse(found, owner["sparse"], dtype, own)
        values = found.astype(np.float64)
        if owner.get("normalized") is True:
            values = _normalised(values, dtype)
        if not np.isfinite(values).all():
            row = int(np.argwhere(~np.isfinite(values))[0, 0])
            self.fail(f"{own}, which {where} needs, is not finite at element {row}")
        return values

    def _dtype(self, owner: dict[str, Any], where: str) -> np.dtype:
        code = self.get(owner, "componentType", int, where)
        if code not in _KINDS:
            self.fail(f"the componentType of {where} is {code}; it may be {sorted(_KINDS)}")
        return np.dtype(_KINDS[code])

    def _elements(
        self, owner: dict[str, Any], count: int, width: int, dtype: np.dtype, where: str
    ) -> NDArray:
        """(count, width) straight from the bytes, without a copy."""
        index = self.get(owner, "bufferView", int, where)
        view, own = self.item("bufferViews", index), f"bufferViews[{index}]"
        for name in ("EXT_meshopt_compression", "KHR_meshopt_compression"):
            if name in self.get(view, "extensions", dict, own, {}):
                self.fail(f"{own} is compressed ({name}); write the file without compression")
        size = width * dtype.itemsize
        stride = self.get(view, "byteStride", int, own, 0) or size
        begin = self.get(owner, "byteOffset", int, where, 0)
        offset = self.get(view, "byteOffset", int, own, 0)
        length = self.get(view, "byteLength", int, own)
        data = self.buffer(self.get(view, "buffer", int, own))
        if min(begin, offset, length, count) < 0 or stride < size or offset + length > len(data):
            self.fail(f"{own}, which {where} lies in, does not lie in its buffer")
        if count and begin + (count - 1) * stride + size > length:
            self.fail(f"{where} tells of {count} elements; {own} ends before the last of them")
        if not count:
            return np.zeros((0, width), dtype=dtype)
        return np.ndarray((count, width), dtype, data, offset + begin, (stride, dtype.itemsize))

    def _with_sparse(self, found: NDArray, sparse: Any, dtype: np.dtype, where: str) -> NDArray:
        own = f"sparse of {where}"
        count = self.get(sparse, "count", int, own)
        at = self.get(sparse, "indices", dict, own)
        kind = self._dtype(at, own)
        if kind.kind != "u":
            self.fail(f"the indices of {own} must be unsigned whole numbers")
        rows = self._elements(at, count, 1, kind, own)[:, 0].astype(np.int64)
        values = self.get(sparse, "values", dict, own)
        given = self._elements(values, count, found.shape[1], dtype, own)
        if len(rows) and rows.max() >= len(found):
            self.fail(f"the {own} replaces element {rows.max()} of {len(found)}")
        found = found.copy()
        found[rows] = given
        return found


def _normalised(values: Array, dtype: np.dtype) -> Array:
    """Integers as the share of their range, as in section 3.6.2.2: signed ones end at -1."""
    if dtype.kind == "f":
        return values
    return np.maximum(values / np.iinfo(dtype).max, -1.0)


def read_bytes(path: Path) -> bytes:
    """All bytes of a file that is no larger than glTF files may be here."""
    try:
        size = os.stat(path).st_size
        if size > LARGEST_FILE:
            raise FootIKError(f"{path}: {size} bytes; the largest file that is read has 1 GiB.")
        return path.read_bytes()
    except FileNotFoundError:
        raise FootIKError(f"{path}: there is no such file.") from None
    except IsADirectoryError:
        raise FootIKError(f"{path}: this is a directory, not a glTF file.") from None
    except (OSError, ValueError, MemoryError) as error:
        reason = getattr(error, "strerror", None) or error
        raise FootIKError(f"{path}: the file cannot be read: {reason}.") from None


def read_container(path: str | os.PathLike[str]) -> Gltf:
    """Read a .glb or .gltf, told apart by its first bytes. Raises FootIKError for anything else."""
    path = Path(path)
    raw = read_bytes(path)
    if raw[:4] != b"glTF":
        return Gltf(path=path, json=_document(raw, path.name), raw=raw, is_glb=False)
    chunks = _chunks(raw, path.name)
    if not chunks or chunks[0][0] != JSON_CHUNK:
        raise FootIKError(f"{path.name}: the first chunk of a GLB file must be its JSON.")
    document = _document(bytes(chunks[0][1]), path.name)
    return Gltf(path=path, json=document, raw=raw, chunks=tuple(chunks[1:]))


def _chunks(raw: bytes, name: str) -> list[tuple[int, memoryview]]:
    if len(raw) < 12:
        raise FootIKError(f"{name}: a GLB file has a header of 12 bytes; this one has {len(raw)}.")
    version, length = struct.unpack_from("<II", raw, 4)
    if version != 2:
        raise FootIKError(f"{name}: GLB version {version}; version 2 is read.")
    if not 12 <= length <= len(raw):
        raise FootIKError(f"{name}: the header tells of {length} bytes; {len(raw)} are there.")
    chunks, at, data = [], 12, memoryview(raw)[:length]
    while at + 8 <= length:
        size, kind = struct.unpack_from("<II", data, at)
        if at + 8 + size > length:
            raise FootIKError(f"{name}: the chunk at byte {at} ends after the end of the file.")
        chunks.append((kind, data[at + 8 : at + 8 + size]))
        at += 8 + size
    return chunks


def _document(text: bytes, name: str) -> dict[str, Any]:
    """The JSON object of a file, checked to be glTF 2."""
    brackets = text.count(b"{") + text.count(b"[")
    if brackets > len(text) // 6 + 10_000:  # an empty list weighs twenty times its two letters
        raise FootIKError(f"{name}: {brackets} lists and objects in {len(text)} bytes of JSON.")
    try:
        document = json.loads(text.decode("utf-8-sig"), parse_constant=_no_constant)
    except UnicodeDecodeError:
        raise FootIKError(f"{name}: neither a GLB file nor glTF text (UTF-8 JSON).") from None
    except json.JSONDecodeError as error:
        raise FootIKError(
            f"{name}, line {error.lineno}: the JSON is broken at column {error.colno}: {error.msg}."
        ) from None
    except (ValueError, RecursionError, MemoryError) as error:
        raise FootIKError(f"{name}: the JSON cannot be read: {error}.") from None
    asset = document.get("asset") if isinstance(document, dict) else None
    version = asset.get("version") if isinstance(asset, dict) else None
    if not isinstance(version, str) or not version.startswith("2"):
        raise FootIKError(f"{name}: no glTF 2 document: its asset has no version 2.x.")
    return document


def _no_constant(word: str) -> NoReturn:
    raise ValueError(f"{word} is no JSON number")


def pack_glb(document: dict[str, Any], chunks: Sequence[tuple[int, bytes | memoryview]]) -> bytes:
    """A GLB file: the document and the chunks after it, each padded to 4 bytes."""
    text = dumped(document)
    parts = []
    for kind, data, blank in [(JSON_CHUNK, text, b" "), *((k, d, b"\0") for k, d in chunks)]:
        padding = -len(data) % 4
        parts += [struct.pack("<II", len(data) + padding, kind), data, blank * padding]
    length = 12 + sum(map(len, parts))
    if length >= LARGEST_FILE:
        raise FootIKError(f"the GLB file would have {length} bytes; 1 GiB is the most.")
    return b"".join([struct.pack("<4sII", b"glTF", 2, length), *parts])


def dumped(document: dict[str, Any], indent: int | None = None) -> bytes:
    """JSON text of a document; every number as it was read, to the last bit."""
    separators = (",", ":") if indent is None else (",", ": ")
    try:
        text = json.dumps(document, separators=separators, indent=indent, ensure_ascii=False)
        return text.encode()
    except (ValueError, RecursionError) as error:  # lone surrogates; a document nested too deep
        raise FootIKError(f"the glTF document cannot be written: {error}.") from None
