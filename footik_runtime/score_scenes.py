"""Score scenes: the grounds and ways of going on which feet go wrong, as users complain of them."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from footik_runtime.builtin import builtin_body, builtin_motion
from footik_runtime.motion import Motion
from footik_runtime.score_disturbed import (
    steered_hard,
    with_late_contacts,
    with_wrong_footholds,
)
from footik_runtime.terrain import (
    BEGIN,
    Belt,
    Flat,
    Piece,
    Platform,
    Ramp,
    SideSlope,
    Stairs,
    Step,
    Terrain,
    make_terrain,
)
from footik_runtime.walk import Drive

_START = 1.0  # m of level ground before the first piece


@dataclass(frozen=True, kw_only=True)
class Limits:
    """What a scene's figures should not exceed: units of the measures' table."""

    pinned_point_speed: float = 6.0
    slip_mean: float = 0.1
    penetration: float = 0.5
    penetration_contact_p99: float = 5.0
    penetration_swing_p99: float = 5.0
    float: float = 2.0
    pop: float = 3.0
    hip_acceleration_ratio: float = 2.0
    hip_drop: float = math.inf


WALKING = Limits()
RUNNING = Limits(pinned_point_speed=20.0)
# A quadruped's own hips hardly move up and down at all, so any ground multiplies that.
ON_FOUR_LEGS = Limits(pop=4.0, hip_acceleration_ratio=6.0, hip_drop=15.0)
DISTURBED = Limits(
    pinned_point_speed=12.0,
    slip_mean=0.2,
    penetration=1.0,
    penetration_contact_p99=10.0,
    penetration_swing_p99=10.0,
    float=4.0,
    pop=12.0,
    hip_acceleration_ratio=6.0,
    hip_drop=30.0,
)
"""Twice the others', those of stairs where they are looser."""

CLIMBING = Limits(pop=6.0, hip_acceleration_ratio=3.0, hip_drop=15.0)


@dataclass(frozen=True, kw_only=True)
class ScoreScene:
    """One scene: what is walked on, how, and what should come of it.

    Attributes:
        name: of it in tables.
        complaint: what users see go wrong in such a place.
        terrain: made anew for each run.
        gait: of a built-in character; a clip of the user's takes the place of "walk".
        drive: commands over time; straight on at the motion's own speed where None.
        limits: of its figures.
        seconds: how long.
        change: what is done to the motion first.
    """

    name: str
    complaint: str
    terrain: Callable[[], Terrain]
    gait: str = "walk"
    drive: Drive | None = None
    limits: Limits = WALKING
    seconds: float = 8.0
    change: Callable[[Motion], Motion] | None = None

    @property
    def takes_clips(self) -> bool:
        """Whether a user's clip may take the place of the built-in walk."""
        return self.gait == "walk" and self.drive is None and self.change is None

    def motion(self) -> Motion:
        """The built-in motion."""
        motion = builtin_motion(self.gait)
        return motion if self.change is None else self.change(motion)

    @property
    def body(self) -> Path:
        """The MJCF file of the character that has it."""
        return builtin_body(self.gait)


def score_scenes() -> tuple[ScoreScene, ...]:
    """All scenes of the suite."""
    return (
        ScoreScene(name="flat", complaint="foot IK spoils a good clip", terrain=_named("flat")),
        *_slopes(),
        *_stairs(),
        *_scattered(),
        *_ways(),
        *_moving(),
        *_disturbed(),
        *_on_four_legs(),
    )


def _slopes() -> list[ScoreScene]:
    up, down, across = [], [], []
    for angle in (5.0, 10.0, 15.0, 20.0, 30.0):
        up.append(
            ScoreScene(
                name=f"slope {angle:.0f} up",
                complaint="toes in the ground, hips bounce",
                terrain=_laid(Ramp(angle_deg=angle, length=20.0)),
            )
        )
        down.append(
            ScoreScene(
                name=f"slope {angle:.0f} down",
                complaint="only the heel touches",
                terrain=_laid(Ramp(angle_deg=-angle, length=20.0)),
            )
        )
        across.append(
            ScoreScene(
                name=f"slope {angle:.0f} across",
                complaint="the edge of the sole in the ground",
                terrain=_laid(SideSlope(angle_deg=angle, length=20.0)),
            )
        )
    return [*up, *down, *across]


def _stairs() -> list[ScoreScene]:
    return [
        ScoreScene(
            name=f"stairs {100 * height:.0f} cm {way}",
            complaint="shaking, knees pop, toes through risers",
            terrain=_laid(Stairs(steps=40, step_height=height, down=way == "down")),
            limits=CLIMBING,
        )
        for way in ("up", "down")
        for height in (0.12, 0.15, 0.17, 0.20)
    ]


def _scattered() -> list[ScoreScene]:
    said = {
        "hills": "hips bounce",
        "rubble": "feet through blocks",
        "stones": "feet beside the stone",
        "ledge": "the pelvis is dragged off the edge",
        "gap": "feet in the gap",
    }
    return [
        ScoreScene(name=name, complaint=what, terrain=_named(name)) for name, what in said.items()
    ] + [
        ScoreScene(
            name="drop 40 cm",
            complaint="a landing snaps",
            terrain=_laid(Flat(length=3.0), Step(height_change=-0.4), Flat(length=20.0)),
            limits=CLIMBING,
        ),
    ]


def _ways() -> list[ScoreScene]:
    return [
        ScoreScene(
            name="run, hills",
            complaint="feet late for the ground",
            terrain=_named("hills"),
            gait="run",
            limits=RUNNING,
        ),
        ScoreScene(
            name="turn in place",
            complaint="feet slide and legs twist",
            terrain=_named("flat"),
            gait="turn",
        ),
        ScoreScene(
            name="turn in place, slope 15",
            complaint="feet slide and legs twist",
            terrain=_on_a_slope(15.0),
            gait="turn",
        ),
        ScoreScene(
            name="idle, slope 20",
            complaint="feet hover",
            terrain=_on_a_slope(20.0),
            gait="idle",
        ),
        ScoreScene(
            name="start and stop",
            complaint="feet slide while the speed changes",
            terrain=_named("hills"),
            drive=lambda time: ([1.3 * (0.5 - 0.5 * math.cos(math.pi * time / 2.0)), 0.0], 0.0),
        ),
        ScoreScene(
            name="side steps",
            complaint="feet cross and slide",
            terrain=_named("hills"),
            drive=lambda time: ([0.0, 0.5], 0.0),
        ),
        ScoreScene(
            name="circle",
            complaint="feet turn on the ground",
            terrain=_named("hills"),
            drive=lambda time: ([1.2, 0.0], 0.6),
        ),
    ]


def _moving() -> list[ScoreScene]:
    seesaw = Platform(
        length=5.0, size=(4.0, 4.0), travel=(0.0, 0.0), lift=0.0, turn_deg=0.0, tilt_deg=4.0
    )
    return [
        ScoreScene(
            name="platform",
            complaint="feet inside platforms",
            terrain=_named("platform"),
        ),
        ScoreScene(
            name="belt",
            complaint="feet slide on what moves",
            terrain=_laid(Belt(length=20.0, speed=0.3)),
        ),
        ScoreScene(
            name="seesaw",
            complaint="feet through what tilts",
            terrain=_laid(*[seesaw] * 4),
        ),
    ]


def _on_four_legs() -> list[ScoreScene]:
    grounds = {
        "flat": ("foot IK spoils a good clip", _named("flat")),
        "slope 15 up": ("the body stays level", _laid(Ramp(angle_deg=15.0, length=20.0))),
        "slope 15 down": ("the body stays level", _laid(Ramp(angle_deg=-15.0, length=20.0))),
        "stairs 12 cm up": (
            "hind paws find no step",
            _laid(Stairs(steps=40, step_height=0.12)),
        ),
        "stairs 12 cm down": (
            "front legs too short",
            _laid(Stairs(steps=40, step_height=0.12, down=True)),
        ),
        "rubble": ("the body shakes", _named("rubble")),
    }
    return [
        ScoreScene(
            name=f"{gait}, {name}",
            complaint=what,
            terrain=terrain,
            gait=gait,
            limits=ON_FOUR_LEGS,
        )
        for gait in ("quadruped walk", "trot")
        for name, (what, terrain) in grounds.items()
    ]


def _disturbed() -> list[ScoreScene]:
    said: list[tuple[str, Callable[[Motion], Motion] | None, Drive | None]] = [
        ("contacts 60 ms early", partial(with_late_contacts, seconds=-0.06), None),
        ("contacts 60 ms late", partial(with_late_contacts, seconds=0.06), None),
        ("footholds 10 cm off", partial(with_wrong_footholds, metres=0.1), None),
        ("steered hard", None, steered_hard(1.3)),
    ]
    return [
        ScoreScene(
            name=f"{name}, {ground}",
            complaint="feet flip, sink or pop when their clip is wrong",
            terrain=terrain,
            drive=drive,
            change=change,
            limits=DISTURBED,
        )
        for name, change, drive in said
        for ground, terrain in (
            ("hills", _named("hills")),
            ("stairs 15 cm up", _laid(Stairs(steps=40, step_height=0.15))),
        )
    ]


def _named(name: str) -> Callable[[], Terrain]:
    return lambda: make_terrain(name)


def _laid(*pieces: Piece) -> Callable[[], Terrain]:
    """These pieces after a level start and before a level end."""
    laid = (Flat(length=_START - BEGIN), *pieces, Flat(length=30.0))
    return lambda: Terrain(name="score", pieces=laid)


def _on_a_slope(angle: float) -> Callable[[], Terrain]:
    """A slope across the way under the start itself."""
    begin = SideSlope(angle_deg=angle, length=-2.0 * BEGIN)
    return lambda: Terrain(name="score", pieces=(begin, Flat(length=10.0)))
