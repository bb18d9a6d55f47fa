"""The error root: one sentence that lists the valid names and suggests the nearest."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from footik_runtime.errors import FootIKError, listed, unknown_name

JOINTS = ("Hips", "LeftFoot", "RightFoot")


def test_unknown_name_suggests_the_nearest_and_lists_the_valid_ones():
    error = unknown_name("joint", "LeftFot", JOINTS)
    assert isinstance(error, FootIKError)
    assert str(error) == (
        "unknown joint 'LeftFot'. Did you mean 'LeftFoot'? Valid: Hips, LeftFoot, RightFoot."
    )


def test_nearest_name_is_found_whatever_the_case_and_keeps_its_own():
    assert "Did you mean 'RightFoot'?" in str(unknown_name("joint", "RIGHTFOOT", JOINTS))


def test_a_name_that_is_near_to_none_gets_no_suggestion():
    message = str(unknown_name("joint", "xyz", JOINTS))
    assert "Did you mean" not in message
    assert message.endswith("Valid: Hips, LeftFoot, RightFoot.")


def test_any_iterable_of_names_will_do_once():
    assert "Valid: Hips, LeftFoot" in str(unknown_name("joint", "hip", iter(JOINTS)))


@given(st.integers(0, 12), st.integers(1, 12))
def test_list_is_cut_after_its_limit_and_says_how_many_there_are(count, limit):
    names = [f"n{i}" for i in range(count)]
    line = listed(names, limit)
    if count <= limit:
        assert line == ", ".join(names)
    else:
        assert line == f"{', '.join(names[:limit])}, … ({count} in all)"


@given(st.text(), st.lists(st.text(min_size=1), min_size=1))
def test_any_unknown_name_makes_a_message_that_holds_it(name, valid):
    assert repr(name) in str(unknown_name("thing", name, valid))


def test_every_valid_name_is_suggested_for_itself():
    for name in JOINTS:
        with pytest.raises(FootIKError, match=f"Did you mean '{name}'"):
            raise unknown_name("joint", name.lower(), JOINTS)
