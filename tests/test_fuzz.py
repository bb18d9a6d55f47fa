"""Broken files: every reader refuses them with FootIKError, quickly and in little memory."""

from __future__ import annotations

import sys
import time
from pathlib import Path

import numpy as np
import pytest

from footik_runtime.clip import Clip
from footik_runtime.errors import FootIKError
from footik_runtime.formats import read_bvh

sys.path.insert(0, str(Path(__file__).parents[1] / "benchmarks"))

from fuzz_formats import Whole, formats, fuzz, judge, seeds  # pyright: ignore[reportMissingImports]
from mutated_files import mutated  # pyright: ignore[reportMissingImports]


@pytest.fixture(scope="module")
def whole(tmp_path_factory) -> list[Whole]:
    return seeds(None, tmp_path_factory.mktemp("whole"))


def test_broken_files_are_refused_and_nothing_else(whole: list[Whole]):
    ends, failures = fuzz(whole, count=540)
    assert not failures
    assert sum(ends.values()) == 540
    for kind in formats():  # some still read, some do not: the mutations are worth something
        assert ends[f"{kind} read"] > 0
        assert ends[f"{kind} refused"] > 10


def test_the_same_seed_makes_the_same_files(whole: list[Whole]):
    for file in whole:
        data = file.path.read_bytes()
        a, b, c = (mutated(data, file.path.suffix, np.random.default_rng(s)) for s in (1, 1, 2))
        assert a == b != c


def _raises(path: Path) -> Clip:
    raise KeyError(path)


def _slow(path: Path) -> Clip:
    began = time.process_time()
    while time.process_time() < began + 1.2:
        pass
    raise FootIKError("slow")


def _large(path: Path) -> Clip:
    raise FootIKError(f"large: {len(bytes(40 << 20))}")


def _warns(path: Path) -> Clip:
    raise FootIKError(str(np.float32(3e38) * np.float32(10)))


@pytest.mark.parametrize(
    ("reader", "wrong"),
    [(_raises, "KeyError"), (_slow, " s"), (_large, "MB of memory"), (_warns, "RuntimeWarning")],
)
def test_a_reader_that_fails_is_caught(reader, wrong: str, tmp_path: Path):
    assert wrong in judge(tmp_path / "a.bvh", reader, None, 10).wrong


def test_many_joints_without_channels_make_no_clip_out_of_proportion(tmp_path: Path):
    joints = "JOINT j%d { OFFSET 0 0 0 CHANNELS 0 "
    text = "HIERARCHY ROOT r { OFFSET 0 0 0 CHANNELS 1 Xrotation "
    text += "".join(joints % n for n in range(3000)) + "}" * 3001
    text += "\nMOTION\nFrames: 20000\nFrame Time: 0.01\n" + "1\n" * 20000
    path = tmp_path / "a.bvh"
    path.write_text(text)
    outcome = judge(path, read_bvh, None, len(text))
    assert (outcome.ended, outcome.wrong) == ("refused", "")
