"""The phases of a foot's contact, and the names of the curves that carry them in a clip."""

from __future__ import annotations

from enum import IntEnum


class Phase(IntEnum):
    """What of a foot is on the ground, and so which sole point is pinned."""

    SWING = 0
    """Nothing: the foot is in the air."""
    HEEL = 1
    """The heel, after the strike; the foot turns over it."""
    FLAT = 2
    """Heel and ball; the foot does not move at all."""
    BALL = 3
    """The ball, after heel-off; the foot turns over it and the toes stay down."""


SWING = Phase.SWING
HEEL = Phase.HEEL
FLAT = Phase.FLAT
BALL = Phase.BALL


def weight_curve(leg_name: str) -> str:
    """The curve of a leg's IK weight, at least .5 in contact: "LeftFootIKWeight" for "left"."""
    return f"{_camel(leg_name)}FootIKWeight"


def phase_curve(leg_name: str) -> str:
    """The curve of a leg's contact phase, values of `Phase`: "LeftFootPhase" for "left"."""
    return f"{_camel(leg_name)}FootPhase"


def lock_curve(leg_name: str) -> str:
    """The curve of what a planted foot keeps, values of `LOCKS` by number: "LeftFootLock"."""
    return f"{_camel(leg_name)}FootLock"


def heel_curve(leg_name: str) -> str:
    """The curve of a leg's heel weight, at least .5 while the heel carries: "LeftHeelIKWeight"."""
    return f"{_camel(leg_name)}HeelIKWeight"


def toe_curve(leg_name: str) -> str:
    """The same of the ball and toes: "LeftToeIKWeight"."""
    return f"{_camel(leg_name)}ToeIKWeight"


def _camel(name: str) -> str:
    words = name.replace("_", " ").replace("-", " ").split()
    return "".join(word[:1].upper() + word[1:] for word in words)
