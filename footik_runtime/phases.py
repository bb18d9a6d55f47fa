"""Phases of a contact, and the names of the curves that carry them."""

from __future__ import annotations

from enum import IntEnum


class Phase(IntEnum):
    """What a foot does: each phase of a contact pins its own sole point."""

    SWING = 0
    HEEL = 1
    FLAT = 2
    BALL = 3


def _title(leg_name: str) -> str:
    return "".join(part.capitalize() for part in leg_name.split("_"))


def weight_curve(leg_name: str) -> str:
    """The name of a leg's IK-weight curve: LeftFootIKWeight for the leg "left"."""
    return f"{_title(leg_name)}FootIKWeight"


def phase_curve(leg_name: str) -> str:
    """The name of a leg's contact-phase curve: LeftFootPhase for the leg "left"."""
    return f"{_title(leg_name)}FootPhase"
