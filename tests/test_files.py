"""Files are written whole or not at all."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from footik_runtime.errors import FootIKError
from footik_runtime.files import remove, require_writable, write_whole


def test_a_file_that_cannot_be_written_is_one_error(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("x")
    for path in (tmp_path / "file" / "x", tmp_path / ("a" * 300), f"{tmp_path}/a\0b"):
        with pytest.raises(FootIKError, match="cannot be written"):
            write_whole(path, b"")
    assert [p.name for p in tmp_path.iterdir()] == ["file"]


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no named pipes here")
def test_a_device_is_written_to_and_not_replaced(tmp_path: Path) -> None:
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    reader = os.open(pipe, os.O_RDONLY | os.O_NONBLOCK)
    require_writable(pipe)
    write_whole(pipe, b"told")
    assert os.read(reader, 10) == b"told"
    os.close(reader)
    assert pipe.is_fifo()


def test_a_protected_file_is_neither_replaced_nor_removed(tmp_path: Path, monkeypatch) -> None:
    kept = tmp_path / "kept"
    kept.write_text("x")
    monkeypatch.setattr(os, "access", lambda path, _mode: Path(path) != kept)  # root may do all
    for write in (lambda: write_whole(kept, b"y"), lambda: require_writable(kept),
                  lambda: remove(kept)):  # fmt: skip
        with pytest.raises(FootIKError, match="kept: the file is write-protected"):
            write()
    assert kept.read_text() == "x"
    assert [path.name for path in tmp_path.iterdir()] == ["kept"]
