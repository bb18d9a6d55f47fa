"""BVH: reading both dialects, every odd file and its message, and writing back the same digits."""

from __future__ import annotations

import itertools
import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from footik_runtime.clip import Clip
from footik_runtime.errors import FootIKError
from footik_runtime.formats import BvhLayout, read_bvh, write_bvh
from footik_runtime.formats.number_text import read_numbers
from footik_runtime.skeleton import Skeleton

SHARED = Path(os.environ.get("FOOTIK_SHARED", Path(__file__).parents[1] / "../shared"))
REAL = sorted((SHARED / "data" / "bvh").glob("*.bvh"))
needs_shared = pytest.mark.skipif(not REAL, reason="FOOTIK_SHARED holds no data/bvh")

LEGS = """HIERARCHY
ROOT Hips
{
  OFFSET 0 0 0
  CHANNELS 6 Xposition Yposition Zposition Zrotation Yrotation Xrotation
  JOINT Spine
  {
    OFFSET 0 30 0
    CHANNELS 3 Zrotation Yrotation Xrotation
    End Site
    {
      OFFSET 0 50 0
    }
  }
  JOINT LeftLeg
  {
    OFFSET 10 -45 0
    CHANNELS 3 Zrotation Yrotation Xrotation
    End Site
    {
      OFFSET 0 -45 0
    }
  }
  JOINT RightLeg
  {
    OFFSET -10 -45 0
    CHANNELS 1 Xrotation
    End Site
    {
      OFFSET 0 -45 0
    }
  }
}
MOTION
Frames: 2
Frame Time: .0083333
1 90 3 10 20 30 1 2 3 4 5 6 7
2 91 4 11 21 31 1 2 3 4 5 6.50 -0.0
"""


@pytest.fixture
def file(tmp_path: Path):
    """Put text (or bytes) into a file named clip.bvh."""

    def make(text: str | bytes = LEGS) -> Path:
        path = tmp_path / "clip.bvh"
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
        return path

    return make


def one_joint(channels: str, values: str, offset: str = "0 0 0") -> str:
    """A file with one joint, one frame."""
    return (
        f"HIERARCHY\nROOT a\n{{\nOFFSET {offset}\nCHANNELS {len(channels.split())} {channels}\n"
        f"End Site\n{{\nOFFSET 0 100 0\n}}\n}}\nMOTION\nFrames: 1\nFrame Time: 0.01\n{values}\n"
    )


def same_bits(a: Clip, b: Clip) -> None:
    assert a.fps == b.fps
    assert a.skeleton.names == b.skeleton.names
    np.testing.assert_array_equal(a.skeleton.parents, b.skeleton.parents)
    np.testing.assert_array_equal(a.skeleton.offsets, b.skeleton.offsets)
    assert a.skeleton.tips.keys() == b.skeleton.tips.keys()
    for joint, tip in a.skeleton.tips.items():
        np.testing.assert_array_equal(tip, b.skeleton.tips[joint])
    np.testing.assert_array_equal(a.root_positions, b.root_positions)
    np.testing.assert_array_equal(a.rotations, b.rotations)
    assert (a.translations is None) == (b.translations is None)
    if a.translations is not None:
        np.testing.assert_array_equal(a.translations, b.translations)


# --- reading ------------------------------------------------------------------------------------


@needs_shared
@pytest.mark.parametrize(
    ("name", "frames", "scale"),
    [("cmu_02_01_walk", 343, 0.01), ("cmu_01_01_playground", 2752, 0.056444)],
)
def test_both_cmu_dialects_are_read_in_metres_z_up(name, frames, scale):
    clip = read_bvh(SHARED / "data" / "bvh" / f"{name}.bvh")
    assert (len(clip), clip.fps, len(clip.skeleton)) == (frames, 120.0, 31)
    layout = clip.extras["bvh"]
    assert isinstance(layout, BvhLayout)
    assert (layout.up, layout.scale) == ("y", scale)
    rest, _ = clip.skeleton.rest_pose()
    legs = {"lhipjoint": "ltoes", "LHipJoint": "LeftToeBase"}
    toe = next(t for hip, t in legs.items() if hip in clip.skeleton.names)
    assert -1.1 < rest[clip.skeleton.index(toe)][2] < -0.8
    assert len(clip.skeleton.tips) == 7 or len(clip.skeleton.tips) == 5
    assert 0.5 < clip.root_positions[0, 2] < 1.2


def test_y_up_is_turned_by_a_permutation_that_keeps_every_digit(file):
    clip = read_bvh(file(), scale=1.0)
    np.testing.assert_array_equal(clip.root_positions, [[3, 1, 90], [4, 2, 91]])
    np.testing.assert_array_equal(clip.skeleton.offsets[2], [0, 10, -45])
    np.testing.assert_array_equal(clip.skeleton.tips[1], [0, 0, 50])
    raw = read_bvh(file(), scale=1.0, up="z")
    np.testing.assert_array_equal(raw.root_positions, [[1, 90, 3], [2, 91, 4]])
    np.testing.assert_array_equal(clip.rotations, raw.rotations[..., [0, 3, 1, 2]])


@pytest.mark.parametrize("order", ["".join(p) for p in itertools.permutations("XYZ")] + ["ZXZ"])
def test_every_rotation_order_matches_scipy(file, order):
    angles = np.random.default_rng(3).uniform(-400, 400, 3)
    text = one_joint(" ".join(f"{a}rotation" for a in order), " ".join(map(repr, angles.tolist())))
    clip = read_bvh(file(text), up="z", scale=1.0)
    wanted = Rotation.from_euler(order, angles, degrees=True).as_quat(scalar_first=True)
    found = clip.rotations[0, 0]
    np.testing.assert_allclose(found * np.sign(found @ wanted), wanted, atol=1e-14)


def test_channels_may_come_in_any_mix_order_and_case(file):
    mixed = one_joint("xrotation ZPOSITION Yrotation xPosition", "10 3 20 1", offset="7 8 9")
    clip = read_bvh(file(mixed), up="z", scale=1.0)
    np.testing.assert_array_equal(clip.root_positions, [[1, 8, 3]])  # y keeps the offset
    wanted = Rotation.from_euler("XY", [10, 20], degrees=True).as_quat(scalar_first=True)
    np.testing.assert_allclose(clip.rotations[0, 0], wanted, atol=1e-15)


def test_a_joint_may_have_no_channels(file):
    text = LEGS.replace("CHANNELS 1 Xrotation", "CHANNELS 0").replace(" 7\n", "\n")
    clip = read_bvh(file(text.replace(" -0.0", "")))
    np.testing.assert_array_equal(clip.rotations[:, 3], [[1, 0, 0, 0]] * 2)


def test_positions_of_other_joints_become_translations(file):
    text = LEGS.replace("CHANNELS 1 Xrotation", "CHANNELS 2 Yposition Xrotation")
    text = text.replace(" 7\n", " -50 7\n").replace("-0.0", "-51 -0.0")
    clip = read_bvh(file(text), scale=1.0)
    assert clip.translations is not None
    np.testing.assert_array_equal(clip.translations[:, 3], [[0, -10, -50], [0, -10, -51]])
    np.testing.assert_array_equal(clip.translations[:, 2], [clip.skeleton.offsets[2]] * 2)
    assert read_bvh(file()).translations is None


@pytest.mark.parametrize(
    "dialect",
    [
        lambda t: t.replace("\n", "\r\n"),
        lambda t: t.replace("\n", "\r"),
        lambda t: t.replace("\n", "  \t\n\n \n"),
        lambda t: t.replace("  ", "\t"),
        lambda t: t.rstrip(),
        lambda t: "\ufeff" + t,
        lambda t: t.replace("\n  {", " {").replace("\n{", "{"),
        lambda t: t.replace("Frames:", "frames :").replace("Frame Time: ", "FRAME TIME:"),
        lambda t: t.replace(" 4 5 6", "\n4 5 6"),  # frames wrapped over lines
    ],
    ids=["crlf", "cr", "blank", "tabs", "no_end", "bom", "brace", "case", "wrapped"],
)
def test_white_space_and_spelling_make_no_difference(file, dialect):
    same_bits(read_bvh(file()), read_bvh(file(dialect(LEGS))))


@pytest.mark.parametrize("told", ["400", "1", "0", "-5", "9" * 5000])
def test_the_frames_that_are_there_count_and_a_lying_header_is_noted(file, told):
    clip = read_bvh(file(LEGS.replace("Frames: 2", f"Frames: {told}")))
    assert len(clip) == 2
    assert any("The header tells of" in note and "holds 2" in note for note in clip.extras["notes"])


def test_an_honest_header_leaves_no_such_note(file):
    assert not any("header" in note or "cut" in note for note in read_bvh(file()).extras["notes"])


def test_a_cut_last_frame_is_left_out_and_noted(file):
    clip = read_bvh(file(LEGS.replace(" 5 6.50 -0.0\n", "")))
    assert len(clip) == 1
    assert "The last frame is cut after 10 of 13 values." in clip.extras["notes"]


@pytest.mark.parametrize(
    ("text", "fps"),
    [("0.00833333", 120), (".0083333", 120), (".0333333", 30), ("0.04", 25), ("0.0166667", 60),
     ("0.0333667", 30000 / 1001), ("0.4", 2.5), ("1e-2", 100)],
)  # fmt: skip
def test_the_frame_rate_behind_a_rounded_frame_time_is_found(file, text, fps):
    clip = read_bvh(file(LEGS.replace(".0083333", text)))
    assert clip.fps == fps
    write_bvh(clip, out := file().with_name("out.bvh"))
    assert f"Frame Time: {text}\n" in out.read_text()


def z_up(text: str) -> str:
    """LEGS with its offsets turned to z up."""
    lines = []
    for line in text.splitlines():
        words = line.split()
        if words and words[0] == "OFFSET":
            line = f"OFFSET {words[3]} {words[1]} {words[2]}"
        lines.append(line)
    return "\n".join(lines)


def test_up_axis_is_found_from_the_rest_pose_and_can_be_given(file):
    found = read_bvh(file(z_up(LEGS)))
    assert found.extras["bvh"].up == "z"
    np.testing.assert_array_equal(found.skeleton.offsets, read_bvh(file()).skeleton.offsets)
    assert read_bvh(file(z_up(LEGS)), up="y").extras["bvh"].up == "y"


def test_up_axis_is_found_from_the_motion_where_all_bones_rest_along_one_axis(file):
    text = z_up(LEGS)
    for old, new in [("0 0 30", "30 0 0"), ("0 0 50", "50 0 0"), ("0 0 -45", "45 0 0"),
                     ("0 10 -45", "45 10 0"), ("0 -10 -45", "45 -10 0")]:  # fmt: skip
        text = text.replace(f"OFFSET {old}", f"OFFSET {new}")
    motion = text.index(".0083333") + len(".0083333")
    posed = text[:motion] + "\n0 0 0 0 90 0 0 180 0 0 0 0 0\n"
    assert read_bvh(file(posed)).extras["bvh"].up == "z"
    still = text[:motion] + "\n" + "0 " * 13 + "\n"
    assert any("not clear" in note for note in read_bvh(file(still)).extras["notes"])


@pytest.mark.parametrize("unit", [1.0, 0.01, 0.0254, 0.001, 0.056444])
def test_the_unit_is_guessed_from_human_size_and_noted(file, unit):
    words = [
        "OFFSET " + " ".join(repr(float(n) * 0.01 / unit) for n in line.split()[1:])
        if line.strip().startswith("OFFSET")
        else line
        for line in LEGS.splitlines()
    ]
    clip = read_bvh(file("\n".join(words)))
    assert clip.extras["bvh"].scale == unit
    assert any("Scale" in note for note in clip.extras["notes"])
    assert read_bvh(file(), scale=2.5).skeleton.offsets[1, 2] == 75.0


WORDS = st.one_of(
    st.floats().map(repr),
    st.decimals(-1000, 1000, places=4).map(str),
    st.from_regex(r"[+-]?[0-9]{0,20}\.?[0-9]{0,25}(e[+-]?[0-9]{1,2})?", fullmatch=True),
).filter(lambda word: any(c.isdigit() for c in word.split("e")[0]))


@given(st.lists(WORDS, max_size=8), st.sampled_from([" ", "\n", "\t\r\n "]))
def test_numbers_are_read_to_the_last_bit(words, blank):
    values, begins = read_numbers(blank.join(words).encode())
    wanted = np.array([float(word) for word in words])
    np.testing.assert_array_equal(values, wanted)
    np.testing.assert_array_equal(np.signbit(values), np.signbit(wanted))
    assert len(begins) == len(words)


# --- errors -------------------------------------------------------------------------------------

BAD = {
    "empty": ("", 1, "is empty"),
    "blank": ("\n \n", 1, "is empty"),
    "binary": (b"HIERARCHY\n\x00\x01", 2, "binary"),
    "other": ("glTF 1", 1, "begins with HIERARCHY, not 'glTF'"),
    "two_roots": (LEGS.replace("MOTION", "ROOT b\n{\n}\nMOTION"), 34, "a second ROOT"),
    "root_inside": (LEGS.replace("JOINT Spine", "ROOT Spine"), 6, "a second ROOT"),
    "no_root": ("HIERARCHY\nMOTION\n", 2, "no ROOT"),
    "joint_first": ("HIERARCHY\nJOINT a\n", 2, "expected ROOT, not 'JOINT'"),
    "unclosed": (LEGS[: LEGS.index("MOTION") - 2], 33, "not the end of the file"),
    "cut_offset": (LEGS[: LEGS.index(" 30 0")], 8, "three finite numbers, not the end of the file"),
    "no_brace": (LEGS.replace("{", "", 1), 4, "expected '{' after 'ROOT Hips'"),
    "no_name": (LEGS.replace("Spine", ""), 6, "a JOINT needs a name"),
    "twice": (LEGS.replace("Spine", "Hips"), 6, "a second joint named 'Hips'"),
    "offset_text": (LEGS.replace("0 30 0", "0 x 0"), 8, "joint 'Spine' needs three finite"),
    "offset_nan": (LEGS.replace("0 30 0", "0 nan 0"), 8, "not 'nan'"),
    "no_offset": (LEGS.replace("OFFSET 0 30 0", ""), 14, "joint 'Spine' has no OFFSET"),
    "two_offsets": (LEGS.replace("0 30 0", "0 30 0\nOFFSET 0 0 0"), 9, "a second OFFSET"),
    "channel": (LEGS.replace("1 Xrotation", "1 Xrotatoin"), 27, "Did you mean 'Xrotation'?"),
    "count": (LEGS.replace("CHANNELS 1", "CHANNELS 99"), 27, "count of 0 to 6, not '99'"),
    "places": (one_joint("Xposition Xposition", "1 2"), 5, "each position once"),
    "turns": (one_joint(" ".join(["Xrotation"] * 4), "1 2 3 4"), 5, "three rotations at most"),
    "still": (one_joint("", ""), 11, "no joint has channels"),
    "no_frames": (LEGS.replace("Frames: 2", ""), 36, "expected 'Frames:', not 'Frame'"),
    "frames_text": (LEGS.replace("Frames: 2", "Frames: two"), 35, "whole number, not 'two'"),
    "no_time": (LEGS.replace("Frame Time: .0083333", ""), 37, "expected 'Frame Time:', not '1'"),
    "zero_time": (LEGS.replace(".0083333", "0"), 36, "a positive number of seconds, not '0'"),
    "negative_time": (LEGS.replace(".0083333", "-.01"), 36, "not '-.01'"),
    "nan_time": (LEGS.replace(".0083333", "nan"), 36, "not 'nan'"),
    "no_motion": (LEGS[: LEGS.index("1 90")], 37, "0 of the 13 values"),
    "cut_frame": (LEGS[: LEGS.index(" 6 7\n")], 37, "11 of the 13 values"),
    "word": (LEGS.replace("6.50", "6.5O"), 38, "'6.5O' in the motion is not a number"),
    "comma": (LEGS.replace("6.50", "6,50"), 38, "'6,50'"),
    "glued": (LEGS.replace("6.50", "6-50"), 38, "'6-50'"),
    "underscore": (LEGS.replace("6.50", "6_5"), 38, "'6_5'"),
    "hex": (LEGS.replace("6.50", "0x1"), 38, "'0x1'"),
    "short_line": (LEGS.replace(" 6 7\n", " 6\n"), 37, "the line holds 12 values"),
    "long_line": (LEGS.replace("-0.0", "-0.0 1"), 38, "the line holds 14 values"),
    "nan": (LEGS.replace("6.50", "nan"), 38, "frame 1, joint 'LeftLeg', channel Xrotation is nan"),
    "inf": (LEGS.replace("-0.0", "-inf"), 38, "joint 'RightLeg', channel Xrotation is -inf"),
    "huge": (LEGS.replace("-0.0", "1e999"), 38, "is inf"),
}  # fmt: skip


@pytest.mark.parametrize("case", BAD)
def test_each_fault_is_one_sentence_with_file_and_line(file, case):
    text, line, words = BAD[case]
    with pytest.raises(FootIKError) as caught:
        read_bvh(file(text))
    message = str(caught.value)
    assert message.startswith(f"clip.bvh, line {line}: "), message
    assert words in message
    assert message.endswith(".")
    assert "\n" not in message


def test_files_that_are_not_there_say_so(tmp_path):
    with pytest.raises(FootIKError, match=r"gone\.bvh: there is no such file"):
        read_bvh(tmp_path / "gone.bvh")
    with pytest.raises(FootIKError, match="directory"):
        read_bvh(tmp_path)
    with pytest.raises(FootIKError, match="cannot be read"):
        read_bvh("a\0b")


def test_bad_options_are_refused(file):
    with pytest.raises(FootIKError, match=r"unknown up axis 'x'.*Valid: y, z"):
        read_bvh(file(), up="x")  # pyright: ignore[reportArgumentType]
    for scale in (0.0, -1.0, float("nan"), float("inf")):
        with pytest.raises(FootIKError, match="scale must be positive"):
            read_bvh(file(), scale=scale)
    with pytest.raises(FootIKError, match=r"clip\.bvh: .*not finite"):
        read_bvh(file(), scale=1e307)


def test_a_hierarchy_ten_thousand_deep_is_read_and_written(file, tmp_path):
    deep = 10_000
    parts = ["HIERARCHY", "ROOT j0 { OFFSET 0 1 0 CHANNELS 1 Xrotation"]
    parts += [f"JOINT j{n} {{ OFFSET 0 1 0 CHANNELS 1 Xrotation" for n in range(1, deep)]
    parts += ["}"] * deep + ["MOTION", "Frames: 1", "Frame Time: 1", "0 " * deep]
    clip = read_bvh(file("\n".join(parts)))
    assert len(clip.skeleton) == deep
    write_bvh(clip, tmp_path / "out.bvh")
    same_bits(clip, read_bvh(tmp_path / "out.bvh"))


@pytest.mark.parametrize(
    "hostile",
    ["Frames:" + " " * 300_000, "9" * 300_000 + "x", "{" * 300_000, " \n" * 150_000, "-" * 300_000],
    ids=["spaces", "digits", "braces", "lines", "signs"],
)
def test_hostile_text_fails_in_linear_time(file, hostile):
    for mark in ("Frames: 2\n", "6.50", "0 30 0", "JOINT Spine"):
        with pytest.raises(FootIKError) as caught:
            read_bvh(file(LEGS.replace(mark, hostile + " nan")))
        assert len(str(caught.value)) < 400


MUTATIONS = st.lists(
    st.tuples(
        st.integers(0, len(LEGS)),
        st.integers(0, 12),
        st.sampled_from(["", "{", "}", "\n", " ", "nan", "1e999", "-", "JOINT a", "End Site",
                         "\x01", "OFFSET", "CHANNELS 3 ", "MOTION", "Frames:", "é", "7", "e", "."])
        | st.text(max_size=4),
    ),
    min_size=1,
    max_size=4,
)  # fmt: skip


@settings(max_examples=300, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(MUTATIONS)
def test_mutated_files_are_read_or_refused_and_never_crash(tmp_path_factory, mutations):
    text = LEGS
    for at, length, new in mutations:
        text = text[:at] + new + text[at + length :]
    path = tmp_path_factory.getbasetemp() / "mutant.bvh"
    path.write_bytes(text.encode("utf-8", "surrogatepass"))
    try:
        clip = read_bvh(path)
    except FootIKError:
        return
    write_bvh(clip, path)
    same_bits(clip, read_bvh(path, up=clip.extras["bvh"].up, scale=clip.extras["bvh"].scale))


@settings(max_examples=100, deadline=None)
@given(st.binary(max_size=200))
def test_random_bytes_are_refused(tmp_path_factory, data):
    path = tmp_path_factory.getbasetemp() / "bytes.bvh"
    path.write_bytes(b"HIERARCHY\nROOT a\n{" + data)
    with pytest.raises(FootIKError):
        read_bvh(path)


# --- writing ------------------------------------------------------------------------------------


@needs_shared
@pytest.mark.parametrize("path", REAL, ids=lambda p: p.stem)
def test_real_files_come_back_token_for_token(path, tmp_path):
    clip = read_bvh(path)
    write_bvh(clip, tmp_path / "out.bvh")
    assert path.read_bytes().split() == (tmp_path / "out.bvh").read_bytes().split()
    same_bits(clip, read_bvh(tmp_path / "out.bvh"))


def test_an_unchanged_clip_keeps_all_its_text(file, tmp_path):
    write_bvh(read_bvh(file()), tmp_path / "out.bvh")
    assert (tmp_path / "out.bvh").read_text().split() == LEGS.split()


def test_only_changed_values_are_written_anew(file, tmp_path):
    clip = read_bvh(file())
    turned = clip.rotations.copy()
    turned[1, 2] = Rotation.from_euler("XYZ", [0.3, -0.2, 1.1]).as_quat(scalar_first=True)
    moved = clip.root_positions.copy()
    moved[0, 2] = 1.0 / 3.0
    changed = replace(clip, rotations=turned, root_positions=moved)
    write_bvh(changed, tmp_path / "out.bvh")
    frames = [line.split() for line in (tmp_path / "out.bvh").read_text().splitlines()[-2:]]
    source = [line.split() for line in LEGS.splitlines()[-2:]]
    differing = [(t, c) for t in range(2) for c in range(13) if frames[t][c] != source[t][c]]
    assert differing == [(0, 1), (1, 9), (1, 10), (1, 11)]
    again = read_bvh(tmp_path / "out.bvh")
    np.testing.assert_allclose(again.rotations, changed.rotations, atol=1e-15)
    np.testing.assert_allclose(again.root_positions, changed.root_positions, rtol=1e-15)


def test_a_part_cut_from_a_clip_keeps_its_digits(file, tmp_path):
    write_bvh(read_bvh(file()).cut(1, 2), tmp_path / "out.bvh")
    text = (tmp_path / "out.bvh").read_text()
    assert "Frames: 1\n" in text
    assert text.splitlines()[-1] == LEGS.splitlines()[-1]


def test_a_joint_gets_the_channels_it_lacks_when_it_needs_them(file, tmp_path):
    clip = read_bvh(file())
    turned = clip.rotations.copy()
    turned[1, 3] = [0.5, 0.5, -0.5, 0.5]
    moves = np.tile(clip.skeleton.offsets, (2, 1, 1))
    moves[1, 1] += 0.25
    changed = replace(clip, rotations=turned, translations=moves)
    write_bvh(changed, tmp_path / "out.bvh")
    again = read_bvh(tmp_path / "out.bvh")
    np.testing.assert_allclose(again.rotations, changed.rotations, atol=1e-15)
    assert again.translations is not None
    np.testing.assert_allclose(again.translations, moves, atol=1e-15)
    assert again.extras["bvh"].channels[2] == clip.extras["bvh"].channels[2]


def test_changed_offsets_frame_rate_and_names_are_written(file, tmp_path):
    clip = read_bvh(file())
    skeleton = replace(clip.skeleton, offsets=clip.skeleton.offsets * [1, 1, 1.1])
    write_bvh(replace(clip, skeleton=skeleton, fps=59.0), tmp_path / "out.bvh")
    again = read_bvh(tmp_path / "out.bvh")
    np.testing.assert_allclose(again.skeleton.offsets, skeleton.offsets, rtol=1e-15)
    assert again.fps == 59.0
    assert "OFFSET 0 0 0\n" in (tmp_path / "out.bvh").read_text()
    renamed = replace(clip.skeleton, names=("a", "b", "c", "d e"))
    write_bvh(replace(clip, skeleton=renamed), tmp_path / "out.bvh")
    assert read_bvh(tmp_path / "out.bvh").skeleton.names == renamed.names
    bad = replace(clip, skeleton=replace(clip.skeleton, names=("a{", "b", "c", "d")))
    with pytest.raises(FootIKError, match=r"'a\{' cannot be written to BVH"):
        write_bvh(bad, tmp_path / "out.bvh")


def generated(frames: int, size: float = 1.0, seed: int = 0) -> Clip:
    """A human-shaped clip no file was the source of, its joints not depth first."""
    rng = np.random.default_rng(seed)
    offsets = np.array([[0, 0, 0], [0, 0, 0.3], [0, 0.1, -0.1], [0, -0.1, -0.1], [0.01, 0, -0.4],
                        [0.01, 0, -0.4]]) * size  # fmt: skip
    rotations = rng.normal(size=(frames, 6, 4)) + np.array([6, 0, 0, 0])
    rotations /= np.linalg.norm(rotations, axis=-1, keepdims=True)
    return Clip(
        skeleton=Skeleton(
            names=("hips", "head", "l_hip", "r_hip", "l_knee", "r_knee"),
            parents=np.array([-1, 0, 0, 0, 2, 3], dtype=np.int32),
            offsets=offsets,
            tips={4: np.array([0, 0, -0.4]) * size, 5: np.array([0, 0, -0.4]) * size},
        ),
        fps=60.0,
        root_positions=rng.normal(size=(frames, 3)),
        rotations=rotations,
    )


@pytest.mark.parametrize("size", [0.1, 0.35, 1.0, 2.0, 6.0])
def test_generated_clips_come_back_within_1e_12_at_any_size(tmp_path, size):
    clip = generated(50, size)
    write_bvh(clip, tmp_path / "out.bvh")
    again = read_bvh(tmp_path / "out.bvh")
    order = [again.skeleton.index(name) for name in clip.skeleton.names]
    assert again.fps == clip.fps
    np.testing.assert_allclose(again.skeleton.offsets[order], clip.skeleton.offsets, atol=1e-12)
    np.testing.assert_allclose(again.root_positions, clip.root_positions, atol=1e-12)
    mine = again.rotations[:, order]
    mine *= np.sign(np.sum(mine * clip.rotations, axis=-1, keepdims=True))
    np.testing.assert_allclose(mine, clip.rotations, atol=1e-12)
    write_bvh(again, tmp_path / "twice.bvh")
    same_bits(again, read_bvh(tmp_path / "twice.bvh"))


ANGLES = st.one_of(
    st.sampled_from([-180.0, -90.0, 0.0, 90.0, 180.0, 89.9999999, 1e-9]), st.floats(-180, 180)
)


@settings(max_examples=60, deadline=None)
@given(
    st.sampled_from(["".join(p) for p in itertools.permutations("XYZ")] + ["ZXZ", "YXY"]),
    st.lists(st.tuples(ANGLES, ANGLES, ANGLES), min_size=1, max_size=6),
)
def test_euler_angles_come_back_in_any_order_at_gimbal_lock_too(tmp_path_factory, order, frames):
    path = tmp_path_factory.getbasetemp() / "euler.bvh"
    path.write_text(one_joint(" ".join(f"{a}rotation" for a in order), "0 0 0\n" * len(frames)))
    source = read_bvh(path, up="z", scale=1.0)
    turns = Rotation.from_euler(order, frames, degrees=True).as_quat(scalar_first=True)
    clip = replace(source, rotations=turns[:, None])
    write_bvh(clip, path)
    again = read_bvh(path, up="z", scale=1.0)
    assert again.extras["bvh"].channels == source.extras["bvh"].channels
    assert (np.abs(np.sum(again.rotations * clip.rotations, axis=-1)) > 1 - 1e-14).all()


def test_angles_written_run_on_past_half_turns_and_through_gimbal_lock(file, tmp_path):
    frames = 721
    text = one_joint("Zrotation Yrotation Xrotation", "0 0 0\n" * frames)
    clip = read_bvh(file(text), up="z", scale=1.0)
    turn = np.linspace(0, 720, frames)
    for n, axis in enumerate("ZYX"):
        turns = Rotation.from_euler(axis, turn[:, None], degrees=True).as_quat(scalar_first=True)
        write_bvh(replace(clip, rotations=turns[:, None]), tmp_path / "out.bvh")
        lines = (tmp_path / "out.bvh").read_text().splitlines()[-frames:]
        angles = np.array([line.split() for line in lines], dtype=float)
        wanted = np.zeros((frames, 3))
        wanted[:, n] = turn
        np.testing.assert_allclose(angles, wanted, atol=1e-5)


@pytest.mark.parametrize("lock", [90.0, -90.0])
def test_angles_that_gimbal_lock_leaves_open_stay_where_they_were(file, tmp_path, lock):
    wanted = np.array([[turn, lock, 20.0] for turn in np.linspace(0, 300, 61)])
    text = one_joint("Zrotation Yrotation Xrotation", "0 0 20\n" + "0 0 0\n" * 60)
    clip = read_bvh(file(text), up="z", scale=1.0)
    turns = Rotation.from_euler("ZYX", wanted, degrees=True).as_quat(scalar_first=True)
    turns[0] = clip.rotations[0, 0]  # kept: 0 0 20
    write_bvh(replace(clip, rotations=turns[:, None]), tmp_path / "out.bvh")
    lines = (tmp_path / "out.bvh").read_text().splitlines()[-60:]
    angles = np.array([line.split() for line in lines], dtype=float)
    np.testing.assert_allclose(angles, wanted[1:], atol=1e-6)


def test_writing_is_whole_or_nothing_and_leaves_the_source_alone(file, tmp_path, monkeypatch):
    source = file()
    clip = read_bvh(source)
    out = tmp_path / "out.bvh"
    out.write_text("old")

    def fail(*_):
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr(os, "replace", fail)
        with pytest.raises(FootIKError, match="cannot be written: No space left"):
            write_bvh(clip, out)
    assert out.read_text() == "old"
    assert sorted(p.name for p in tmp_path.iterdir()) == ["clip.bvh", "out.bvh"]
    with pytest.raises(FootIKError, match="cannot be written"):
        write_bvh(clip, tmp_path / "no" / "where.bvh")
    assert source.read_text() == LEGS
