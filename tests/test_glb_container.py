"""glTF's outside: chunks, buffers, accessors, and the message for each thing wrong with them."""

from __future__ import annotations

import json
import struct
import tracemalloc
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from gltf_files import Document

from footik_runtime.errors import FootIKError
from footik_runtime.formats.glb_container import BIN_CHUNK, Gltf, pack_glb, read_container

VECTORS = np.array([[1, 2, 3], [4, 5, 6], [7, 8, 9]], dtype="<f4")


def opened(document: Document, tmp_path: Path) -> Gltf:
    return read_container(document.glb(tmp_path / "clip.glb"))


def with_accessor(values: Any = VECTORS, kind: str = "f4", **more: Any) -> Document:
    document = Document([{}])
    document.accessor(values, kind, **more)
    return document


def read(gltf: Gltf, kinds: tuple[str, ...] = ("SCALAR", "VEC3", "VEC4")) -> np.ndarray:
    return gltf.accessor(0, kinds, "the test")


@pytest.mark.parametrize("kind", ["glb", "bin", "data"])
def test_an_accessor_reads_the_same_from_a_chunk_a_file_and_a_data_uri(kind, tmp_path: Path):
    document = with_accessor()
    if kind == "glb":
        path = document.glb(tmp_path / "clip.glb")
    else:
        path = document.gltf(tmp_path / "clip.gltf", embedded=kind == "data")
    np.testing.assert_array_equal(read(read_container(path)), VECTORS)


def test_strides_and_offsets_are_followed(tmp_path: Path):
    document = Document([{}])
    rows = np.arange(20, dtype="<f4").reshape(4, 5)
    document.view(rows.tobytes(), byteStride=20)
    document.json["accessors"] = [
        {"bufferView": 0, "byteOffset": 4, "componentType": 5126, "count": 4, "type": "VEC3"}
    ]
    np.testing.assert_array_equal(read(opened(document, tmp_path)), rows[:, 1:4])


@pytest.mark.parametrize(
    ("kind", "given", "expected"),
    [
        ("i1", [-128, -127, 0, 127], [-1, -1, 0, 1]),
        ("u1", [0, 51, 255, 255], [0, 0.2, 1, 1]),
        ("i2", [-32768, -32767, 0, 32767], [-1, -1, 0, 1]),
        ("u2", [0, 13107, 65535, 65535], [0, 0.2, 1, 1]),
    ],
)
def test_normalised_integers_are_shares_of_their_range(kind, given, expected, tmp_path: Path):
    gltf = opened(with_accessor([given], kind, normalized=True), tmp_path)
    np.testing.assert_allclose(read(gltf), [expected], atol=1e-15)


def test_sparse_elements_replace_others_and_zeros(tmp_path: Path):
    for based in (True, False):
        document = with_accessor()
        rows = document.view(np.array([2], dtype="<u2").tobytes())
        values = document.view(np.array([[9, 9, 9]], dtype="<f4").tobytes())
        owner = document.json["accessors"][0]
        owner["sparse"] = {
            "count": 1,
            "indices": {"bufferView": rows, "componentType": 5123},
            "values": {"bufferView": values},
        }
        if not based:
            del owner["bufferView"]
        expected = (VECTORS if based else 0 * VECTORS).copy()
        expected[2] = 9
        np.testing.assert_array_equal(read(opened(document, tmp_path)), expected)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"count": 4}, "ends before the last"),
        ({"count": -1}, "does not lie"),
        ({"count": 1 << 62}, "ends before the last"),
        ({"count": 2.0}, "must be a whole number"),
        ({"count": True}, "must be a whole number"),
        ({"byteOffset": 4}, "ends before the last"),
        ({"byteOffset": -4}, "does not lie"),
        ({"componentType": 5124}, "componentType"),
        ({"type": "VEC2"}, "needs an accessor of"),
        ({"type": None}, "has no 'type'"),
        ({"bufferView": 7}, r"bufferViews\[7\] is asked for"),
        ({"bufferView": None, "count": 1 << 40}, "ends before|must be|no buffer|has no"),
        ({"sparse": {"count": 1}}, "has no 'indices'"),
        ({"sparse": 3}, "must be an object"),
    ],
)
def test_a_broken_accessor_is_told(change, message, tmp_path: Path):
    document = with_accessor()
    document.json["accessors"][0].update(change)
    with pytest.raises(FootIKError, match=message):
        read(opened(document, tmp_path))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"byteLength": 1 << 40}, "does not lie in its buffer"),
        ({"byteOffset": 12}, "does not lie in its buffer"),
        ({"byteStride": 4}, "does not lie in its buffer"),
        ({"buffer": 1}, r"buffers\[1\] is asked for"),
        ({"extensions": {"EXT_meshopt_compression": {}}}, "compressed"),
    ],
)
def test_a_broken_buffer_view_is_told(change, message, tmp_path: Path):
    document = with_accessor()
    document.json["bufferViews"][0].update(change)
    with pytest.raises(FootIKError, match=message):
        read(opened(document, tmp_path))


def test_zeros_without_a_buffer_cost_no_more_than_the_file(tmp_path: Path):
    document = with_accessor()
    document.json["accessors"][0] = {"componentType": 5126, "count": 1 << 40, "type": "VEC3"}
    with pytest.raises(FootIKError, match="no buffer holds"):
        read(opened(document, tmp_path))


def test_numbers_that_are_not_finite_are_told_with_their_place(tmp_path: Path):
    values = VECTORS.copy()
    values[1, 2] = np.nan
    with pytest.raises(FootIKError, match="not finite at element 1"):
        read(opened(with_accessor(values), tmp_path))


@pytest.mark.parametrize(
    "uri",
    [
        "../a.bin",
        "/etc/passwd",
        "http://a.bc/x.bin",
        "file:///etc/passwd",
        "a\\..\\b",
        "%2e%2e/a",
        "a\0b",
        "",
        "C:/x.bin",
        "sub/../../a.bin",
    ],
)
def test_only_files_beside_the_document_are_opened(uri, tmp_path: Path):
    path = with_accessor().gltf(tmp_path / "clip.gltf")
    document = json.loads(path.read_text())
    document["buffers"][0]["uri"] = uri
    path.write_text(json.dumps(document))
    with pytest.raises(FootIKError, match="only files in the folder"):
        read(read_container(path))


def test_a_link_out_of_the_folder_is_not_followed(tmp_path: Path):
    (tmp_path / "secret.bin").write_bytes(bytes(100))
    (tmp_path / "in").mkdir()
    path = with_accessor().gltf(tmp_path / "in" / "clip.gltf")
    (tmp_path / "in" / "clip.bin").unlink()
    (tmp_path / "in" / "clip.bin").symlink_to(tmp_path / "secret.bin")
    with pytest.raises(FootIKError, match="only files in the folder"):
        read(read_container(path))


@pytest.mark.parametrize(
    ("uri", "message"),
    [
        ("gone.bin", "no such file"),
        ("data:application/octet-stream;base64,AAA", "not base64"),
        ("data:text/plain,abc", "not base64"),
        ("data:application/octet-stream;base64,AAAA", "3 are there"),
        (7, "must be a text"),
    ],
)
def test_a_buffer_that_is_not_there_is_told(uri, message, tmp_path: Path):
    path = with_accessor().gltf(tmp_path / "clip.gltf")
    document = json.loads(path.read_text())
    document["buffers"][0]["uri"] = uri
    path.write_text(json.dumps(document))
    with pytest.raises(FootIKError, match=message):
        read(read_container(path))


GOOD = pack_glb({"asset": {"version": "2.0"}}, [(BIN_CHUNK, b"abcd")])
TEXT = b'{"asset": {"version": "2.0"}, "x": %s}'


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"", "clip.glb, line 1: the JSON is broken"),
        (GOOD[:8], "header of 12 bytes"),
        (GOOD[:4] + struct.pack("<I", 1) + GOOD[8:], "GLB version 1"),
        (GOOD[:-1], "tells of"),
        (GOOD[:12] + struct.pack("<I", 1 << 31) + GOOD[16:], "chunk at byte 12 ends after"),
        (GOOD[:16] + b"BIN\0" + GOOD[20:], "first chunk"),
        (GOOD[:8] + struct.pack("<I", 12) + GOOD[12:], "first chunk"),
        (b"\xff\xfe\xfd", "neither a GLB file nor glTF text"),
        (b"[1]", "no glTF 2 document"),
        (b'{"asset": {"version": "1.0"}}', "no glTF 2 document"),
        (b'{"asset": 3}', "no glTF 2 document"),
        (TEXT % b"NaN", "NaN is no JSON number"),
        (TEXT % (b"9" * 5000), "cannot be read"),
        (TEXT % (b"[" * 9000), "broken|cannot be read"),
        (TEXT % (b"[" + b"[]," * 200_000 + b"1]"), "lists and objects"),
        (b'{\n\n"asset": }', "line 3"),
    ],
)
def test_a_broken_file_is_told(data, message, tmp_path: Path):
    path = tmp_path / "clip.glb"
    path.write_bytes(data)
    with pytest.raises(FootIKError, match=message):
        read_container(path)


def test_a_document_nested_without_end_is_refused(tmp_path: Path):
    path = tmp_path / "clip.gltf"
    path.write_bytes(TEXT % (b'{"aaaaaaaaaaaaaaaa":' * 100_000 + b"1" + b"}" * 100_000))
    with pytest.raises(FootIKError, match=r"clip\.gltf"):
        read_container(path)


def test_no_file_and_a_folder_are_told(tmp_path: Path):
    with pytest.raises(FootIKError, match="no such file"):
        read_container(tmp_path / "gone.glb")
    with pytest.raises(FootIKError, match="directory"):
        read_container(tmp_path)


def test_chunks_keep_their_bytes_and_are_padded(tmp_path: Path):
    path = tmp_path / "clip.glb"
    path.write_bytes(pack_glb({"asset": {"version": "2.0"}}, [(BIN_CHUNK, b"abcde"), (77, b"x")]))
    gltf = read_container(path)
    assert [(kind, bytes(data)) for kind, data in gltf.chunks] == [
        (BIN_CHUNK, b"abcde\0\0\0"),
        (77, b"x\0\0\0"),
    ]
    assert struct.unpack_from("<I", gltf.raw, 8)[0] == len(gltf.raw)
    assert gltf.raw[12 + 8 :].split(b"abcde")[0].rstrip(b"\0").count(b" ") < 4


def test_reading_takes_no_copies_of_a_large_file(tmp_path: Path):
    document = with_accessor(np.zeros((300_000, 3)))
    path = document.glb(tmp_path / "clip.glb")
    tracemalloc.start()
    gltf = read_container(path)
    assert tracemalloc.get_traced_memory()[1] < 1.2 * len(gltf.raw)
    tracemalloc.stop()
