"""Motions that every test may use: made once, and left as they are."""

import pytest

from footik_runtime.builtin import builtin_motion
from footik_runtime.motion import Motion


@pytest.fixture(scope="session")
def idle() -> Motion:
    return builtin_motion("idle")


@pytest.fixture(scope="session")
def walk() -> Motion:
    return builtin_motion("walk")
