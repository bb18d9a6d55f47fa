"""Broken files out of whole ones: seeded mutations of bytes, of numbers, and of what formats hold.

`mutated(data, suffix, rng)` changes a file a little. Bytes are flipped, cut, doubled and spliced in
any format; numbers in a text become odd ones; the JSON of a GLB is changed with its chunk lengths
kept right, and a member of an NPZ with its checksum kept right, so that the readers behind them are
reached and not only the first check.
"""

from __future__ import annotations

import contextlib
import io
import json
import re
import struct
import zipfile
from collections.abc import Callable
from typing import Any

import numpy as np

Rng = np.random.Generator

ODD_NUMBERS = (
    b"0 -1 1 -0 1e308 -1e308 1e-320 1e999 nan inf 2147483648 -2147483649 4294967296 "
    b"9223372036854775808 1" + b"0" * 400 + b" 0.5 1e9 65536 16777216 007 + . 0x10 1_0 --1"
).split()
ODD_WORDS = b'{ } [ ] " , : \\ \0 \xff\xfe JOINT ROOT End Site MOTION CHANNELS OFFSET null'.split(
    b" "
)
ODD_VALUES: list[Any] = [
    *(None, True, False, 0, 1, -1, 2, 3, 7, 2**31, 2**32, 2**63, -(2**63), 10**400, 0.5, 1e-30),
    *(1e300, -0.0, "", "a", "..", "data:,", "VEC4", "rotation", [], {}, [0], [0] * 16, [[]]),
    *([1e38] * 3, [0, 0, 0, 0], {"node": 0}, {"sampler": 0}),
]
_NUMBER = re.compile(rb"[-+]?\d[\d.eE+-]*")


def mutated(data: bytes, suffix: str, rng: Rng) -> bytes:
    """A file with one to six things changed, most often one."""
    kinds = [_flip, _flip, _cut, _double, _splice, _word, _number, _number]
    kinds += {
        ".glb": [_glb_json] * 8 + [_glb_floats] * 4,
        ".npz": [_npz] * 8 + [_npz_values] * 8,
    }.get(suffix, [])
    for _ in range(min(int(rng.geometric(0.6)), 6)):
        data = _one(kinds, rng)(data, rng)
    return data


def _one(choices: list[Any] | tuple[Any, ...], rng: Rng) -> Any:
    return choices[int(rng.integers(len(choices)))]


def _place(data: bytes, rng: Rng) -> int:
    """A byte of the file, more often near its beginning, where formats keep what they are."""
    return int(rng.integers(len(data) + 1) * rng.random() ** int(rng.integers(0, 4)))


def _flip(data: bytes, rng: Rng) -> bytes:
    out = bytearray(data)
    for _ in range(min(int(rng.geometric(0.5)), 8) if out else 0):
        out[min(_place(data, rng), len(out) - 1)] = int(rng.integers(256))
    return bytes(out)


def _cut(data: bytes, rng: Rng) -> bytes:
    start = _place(data, rng)
    if rng.random() < 0.3:
        return data[:start]
    return data[:start] + data[start + int(rng.integers(1, 1 + max(1, len(data) // 8))) :]


def _double(data: bytes, rng: Rng) -> bytes:
    start = _place(data, rng)
    piece = data[start : start + int(rng.integers(1, 200))]
    return data[:start] + piece * int(rng.integers(1, 20)) + data[start:]


def _splice(data: bytes, rng: Rng) -> bytes:
    """A piece of the file over another piece."""
    a, b, size = _place(data, rng), _place(data, rng), int(rng.integers(1, 400))
    return data[:a] + data[b : b + size] + data[a + size :]


def _word(data: bytes, rng: Rng) -> bytes:
    at = _place(data, rng)
    return data[:at] + _one(ODD_WORDS, rng) + data[at + int(rng.integers(0, 3)) :]


def _number(data: bytes, rng: Rng) -> bytes:
    found = _NUMBER.search(data, _place(data, rng))
    if found is None:
        return data
    return data[: found.start()] + _one(ODD_NUMBERS, rng) + data[found.end() :]


def _glb_json(data: bytes, rng: Rng) -> bytes:
    """Change members of a GLB's document; the lengths in the file stay right."""
    try:
        size = struct.unpack_from("<I", data, 12)[0]
        document = json.loads(data[20 : 20 + size])
        for _ in range(int(rng.integers(1, 4))):
            _change(document, rng)
        text = json.dumps(document).encode()
    except (struct.error, ValueError, RecursionError):
        return data
    text += b" " * (-len(text) % 4)
    rest = data[20 + size :]
    head = struct.pack("<4sIIII", b"glTF", 2, 20 + len(text) + len(rest), len(text), 0x4E4F534A)
    return head + text + rest


def _change(document: Any, rng: Rng) -> None:
    """One member somewhere in the document: another value, gone, doubled, or swapped."""
    owner = document
    while True:
        keys = list(owner) if isinstance(owner, dict) else list(range(len(owner)))
        if not keys:
            return
        key = _one(keys, rng)
        inner = owner[key]
        if not isinstance(inner, dict | list) or not inner or rng.random() < 0.1:
            break
        owner = inner
    what = rng.random()
    if what < 0.15:
        del owner[key]
    elif what < 0.25 and isinstance(owner, list):
        owner += [inner] * int(rng.integers(1, 50))
    elif what < 0.4:
        owner[key] = owner[_one(keys, rng)]
    elif what < 0.6 and isinstance(inner, int):
        owner[key] = inner + int(rng.integers(-5, 6))
    else:
        owner[key] = _one(ODD_VALUES, rng)


def _glb_floats(data: bytes, rng: Rng) -> bytes:
    """Odd floats in the binary chunk, where key times and values are."""
    if len(data) < 20:
        return data
    start = 28 + struct.unpack_from("<I", data, 12)[0]
    out = bytearray(data)
    odd = (0.0, -1.0, 1e-30, 1e30, 3e38, float("nan"), float("inf"), 1e6, 0.001)
    for _ in range(int(rng.integers(1, 20))):
        at = start + 4 * int(rng.integers(0, max(1, (len(data) - start) // 4)))
        if at + 4 <= len(out):
            struct.pack_into("<f", out, at, _one(odd, rng))
    return bytes(out)


def _members(data: bytes) -> list[tuple[str, bytes]]:
    """Names and bytes of an NPZ's members; none where it is broken already."""
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as held:
            return [(info.filename, held.read(info)) for info in held.infolist()]
    except Exception:  # in one of the many ways that zipfile knows
        return []


def _zipped(members: list[tuple[str, bytes]], packing: int) -> bytes:
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", packing) as made:
        for name, body in {name: body for name, body in members}.items():
            made.writestr(name, body)
    return out.getvalue()


def _npz_values(data: bytes, rng: Rng) -> bytes:
    """Odd values in one array of an NPZ, or another shape, type or number of rows."""
    members = _members(data)
    if not members:
        return data
    which = int(rng.integers(len(members)))
    name, body = members[which]
    try:
        array = np.load(io.BytesIO(body), allow_pickle=False)
    except Exception:  # broken before
        return data
    what = rng.random()
    if what < 0.6 and array.size and array.dtype.kind in "fiub":
        array = array.copy()
        floats = (0.0, -1.0, 0.5, 1e-30, 1e30, 1e308, float("nan"), float("inf"))
        odd = floats if array.dtype.kind == "f" else (0, 1, 2, 100)
        with np.errstate(over="ignore"):
            for _ in range(int(rng.integers(1, 5))):
                array.flat[int(rng.integers(array.size))] = _one(odd, rng)
    elif what < 0.75:
        array = array[: int(rng.integers(0, 1 + len(array)))] if array.ndim else array[None]
    elif what < 0.9:
        with np.errstate(all="ignore"), contextlib.suppress(ValueError):  # text that is no number
            array = array.astype(_one(("f4", "f2", "i1", "u8", "U3", "c16", "?"), rng))
    else:
        array = array.T if rng.random() < 0.5 else array[..., None]
    out = io.BytesIO()
    np.save(out, array, allow_pickle=False)
    members[which] = (name, out.getvalue())
    return _zipped(members, zipfile.ZIP_STORED)


def _npz(data: bytes, rng: Rng) -> bytes:
    """Change, drop, rename or double a member of an NPZ; its checksums stay right."""
    members = _members(data)
    if not members:
        return data
    which = int(rng.integers(len(members)))
    name, body = members[which]
    what = rng.random()
    if what < 0.1:
        del members[which]
    elif what < 0.2:
        members[which] = (_one(members, rng)[0], body)
    elif what < 0.3:
        members[which] = (name, _one(members, rng)[1])
    else:
        changes: list[Callable[[bytes, Rng], bytes]] = [_flip, _cut, _double, _number, _word]
        members[which] = (name, _one(changes, rng)(body, rng))
    packing = zipfile.ZIP_DEFLATED if rng.random() < 0.2 else zipfile.ZIP_STORED
    return _zipped(members, packing)
