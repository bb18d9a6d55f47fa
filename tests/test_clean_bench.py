"""The bench of cleanup: that its figures are what they say."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from footik_runtime.builtin import humanoid_rig
from footik_runtime.errors import FootIKError
from footik_runtime.formats import save_clip
from footik_runtime.gait import walk
from footik_runtime.offline import clean_bench
from footik_runtime.offline.clean import clean
from footik_runtime.offline.clean_bench import (
    COLUMNS,
    Case,
    cleanup_table,
    files_as_cases,
    generated_cases,
    score_case,
)
from footik_runtime.offline.skate import inject, true_walk
from footik_runtime.offline.stages import CleanSettings

RIG = humanoid_rig()
TRUTH = true_walk(walk(RIG), RIG, cycles=2)
SKATING = Case(name="c", clip=inject(TRUTH, "constant", 0.03), rig=RIG, truth=TRUTH)


def test_skate_is_gone_and_the_truth_found():
    row = score_case(SKATING)
    assert set(row) == set(COLUMNS)
    assert row["before"] > 30.0
    assert row["less"] > 99.0
    assert row["truth"] < 5.0
    assert row["moved"] > 10.0
    assert row["segments"] < 1e-9
    assert row["outside"] < row["outside_leg"]


def test_what_is_clean_is_not_moved():
    row = score_case(Case(name="c", clip=TRUTH.clip, rig=RIG, truth=TRUTH, clean=True))
    assert row["moved"] < 0.1
    assert row["outside_leg"] < 1e-9


def test_a_cleanup_that_does_nothing_scores_so(monkeypatch):
    def nothing(clip, rig):
        return replace(clean(clip, rig), clip=clip)

    monkeypatch.setattr(clean_bench, "clean", nothing)
    row = score_case(SKATING)
    assert row["after"] == row["before"]
    assert row["less"] == 0.0
    assert row["moved"] == 0.0


def test_penetration_float_and_stretched_segments_are_seen(monkeypatch):
    def worse(by):
        def done(clip, rig):
            found = clean(clip, rig)
            roots = found.clip.root_positions + np.array([0.0, 0.0, by])
            return replace(found, clip=replace(found.clip, root_positions=roots))

        return done

    monkeypatch.setattr(clean_bench, "clean", worse(-0.02))
    assert score_case(SKATING)["penetration"] == pytest.approx(20.0, abs=1.0)
    monkeypatch.setattr(clean_bench, "clean", worse(0.02))
    assert score_case(SKATING)["float"] == pytest.approx(20.0, abs=1.0)

    def longer(clip, rig):
        found = clean(clip, rig, settings=CleanSettings())
        shins = np.tile(clip.skeleton.offsets, (len(clip), 1, 1))
        shins[:, RIG.legs[0].ankle] *= 1.01
        return replace(found, clip=replace(found.clip, translations=shins))

    monkeypatch.setattr(clean_bench, "clean", longer)
    assert score_case(SKATING)["segments"] > 3.0


def test_generated_cases_are_every_gait_ground_and_skate():
    names = [case.name for case in generated_cases()]
    assert len(names) == len(set(names)) == 40
    assert "walk, stairs, accelerating" in names


def test_files_and_folders_become_cases(tmp_path):
    (tmp_path / "a").mkdir()
    save_clip(TRUTH.clip, tmp_path / "a" / "one.bvh")
    save_clip(TRUTH.clip, tmp_path / "two.npz")
    names = [case.name for case in files_as_cases([tmp_path])]
    assert names == ["one.bvh", "two.npz"]
    with pytest.raises(FootIKError, match="nowhere"):
        list(files_as_cases([tmp_path / "nowhere.bvh"]))


def test_the_table_has_a_line_for_each_clip():
    lines = cleanup_table({"a": score_case(SKATING), "bb": score_case(SKATING)}).splitlines()
    assert len(lines) == 3
    assert len({len(line) for line in lines}) == 1
    assert "-" not in lines[1].split()[-1]
