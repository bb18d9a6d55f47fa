"""What all tests share: motions made once and left as they are, and hypothesis without a clock."""

import pytest
from hypothesis import settings

from footik_runtime.builtin import builtin_motion
from footik_runtime.motion import Motion

# The first example of a test may compile kernels: a deadline tells nothing here.
settings.register_profile("kernels", deadline=None)
settings.load_profile("kernels")


@pytest.fixture(scope="session")
def idle() -> Motion:
    return builtin_motion("idle")


@pytest.fixture(scope="session")
def walk() -> Motion:
    return builtin_motion("walk")
