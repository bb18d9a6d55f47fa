"""Stages: what each stage of the offline pass hands to the next, and the settings of all."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, fields, replace
from typing import Any, Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from footik_runtime.clip import Clip
from footik_runtime.errors import FootIKError, unknown_name
from footik_runtime.phases import Phase
from footik_runtime.rig import Rig

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]
Ints = NDArray[np.int64]


class Ground(Protocol):
    """True ground that a user gave; without one the ground is found from the plants."""

    def height(self, points: Array) -> Array:
        """(N,) height under points (N, 3), m; NaN where there is none."""
        ...

    def normal(self, points: Array) -> Array:
        """(N, 3) unit normal under points (N, 3)."""
        ...


def _check(settings: Any, most: dict[str, float]) -> None:
    """Raise FootIKError unless every number is finite, 0 or more, and no more than its most."""
    for each in fields(settings):
        value = getattr(settings, each.name)
        numbers = value if isinstance(value, tuple) else (value,)
        for number in numbers:
            if isinstance(number, (bool, str)) or not isinstance(number, (int, float)):
                continue
            high = most.get(each.name, math.inf)
            if not (math.isfinite(number) and 0.0 <= number <= high):
                raise FootIKError(
                    f"setting {each.name} must be in [0, {high:g}] and finite, not {number!r}."
                )


def _check_choice(name: str, value: str, choices: tuple[str, ...]) -> None:
    if value not in choices:
        raise unknown_name(name, str(value), choices)


@dataclass(frozen=True, kw_only=True)
class ContactSettings:
    """Thresholds of contact, for legs of 0.85 m: lengths and speeds scale. Pairs: (heel, toe)."""

    least_smoothing: float = 0.008  # s, sigma of the Gaussian on clean motion
    velocity_noise: float = (
        0.15  # m/s an axis that smoothing may leave: its width follows from the measured noise
    )
    core_speed: tuple[float, float] = (0.40, 0.32)  # surely standing
    strike_speed: tuple[float, float] = (0.48, 1.20)  # a contact reaches back to here
    off_speed: tuple[float, float] = (0.50, 1.20)  # and on to here
    strike_height: tuple[float, float] = (0.028, 0.012)  # off its own plant's height
    off_height: tuple[float, float] = (0.018, 0.020)
    blur_speed: float = 8.0  # m/s^2: speed thresholds rise by this * extra sigma / sqrt(2 pi)
    blur_height: float = 0.2  # m/s: heights rise by this * sigma
    run_from: float = 1.8  # m/s of travel above which heels strike while still moving
    run_gain: float = 1.5
    shortest_core: float = 0.03  # s
    shortest_swing: float = 0.08  # s
    shortest_contact: float = 0.10  # s
    # m/s: the median speed in cores from which on motion counts as captured, not made by
    # formulas
    captured: float = 0.010
    strictest: float = 0.25  # of the thresholds, for feet that stand quite still
    hover: float = 0.04  # m: see detect.py
    hover_alone: float = 0.12  # m: the same of a point that stands nowhere else
    longest_gap: float = 0.20  # s of missing points bridged
    belt: Literal["auto", "none"] = "auto"

    def __post_init__(self) -> None:
        _check(self, {"strictest": 1.0})
        _check_choice("belt", self.belt, ("auto", "none"))


@dataclass(frozen=True, kw_only=True)
class CleanSettings:
    """How footskate is cleaned; lengths are metres, times seconds."""

    preset: Literal["default", "footplant"] = "default"
    contact: ContactSettings = field(default_factory=ContactSettings)
    ease: float = 0.20  # s over which an adjustment fades into a swing (at most half the swing)
    root_window: float = 0.15  # s, sigma of the root's smoothing
    root_follow: float = 0.5  # 0 moves only where a leg cannot reach, 1 with the planted feet
    reach: float = 0.980  # of the leg's length, or the input's own extension where that is longer
    stretch: float = 0.0  # largest share of a leg's length added; 0 for formats that cannot hold it
    keep_below: float = 0.0005  # m: plants whose pins move less are left as they are
    leave_above: float = 0.06  # m, of a leg of 0.85 m: contacts whose pins would move more are none
    snap: bool = True  # soles onto the ground; False keeps each plant's mean height
    level: bool = False  # write the levelled clip
    redetect: bool = False  # ignore contact curves the clip has

    def __post_init__(self) -> None:
        _check(self, {"root_follow": 1.0, "reach": 1.0, "stretch": 0.5})
        _check_choice("preset", self.preset, ("default", "footplant"))


@dataclass(frozen=True, kw_only=True)
class BakeSettings:
    """How contacts become curves; times are seconds."""

    preset: Literal["default", "openkcc"] = "default"
    ease_in: float = (
        0.10  # s, centred on the strike: the curve is .5 half-way between swing and contact frame
    )
    ease_out: float = 0.10
    tolerance: float = 0.005  # largest error of the thinned keys
    rate: float = 30.0  # openkcc only
    grounded_height: float = 0.05  # openkcc only, m
    replace: bool = False

    def __post_init__(self) -> None:
        _check(self, {"tolerance": 0.5})
        _check_choice("preset", self.preset, ("default", "openkcc"))


@dataclass(frozen=True, kw_only=True, eq=False)
class Contacts:
    """(T, F, 2) heel and toe of every foot, told from motion.

    down: the point carries. confidence: 0..1, that it does. ground: height under it, m (working
    frame), of the plant that holds the frame or the nearest in time. plant_height is therefore
    ground during contact. belt: (3,) m/s of what the feet stood on. noise: m, sd of the points'
    noise. sigma: s, the smoothing used.
    """

    fps: float
    down: Bools
    confidence: Array
    ground: Array
    belt: Array
    noise: float = 0.0
    sigma: float = 0.008

    @property
    def foot(self) -> Bools:
        """(T, F) any point down."""
        return np.asarray(self.down.any(axis=-1))

    def phases(self) -> NDArray[np.int8]:
        """(T, F) `Phase`."""
        heel, toe = self.down[..., 0], self.down[..., 1]
        return np.select(
            [heel & toe, heel, toe], [Phase.FLAT, Phase.HEEL, Phase.BALL], Phase.SWING
        ).astype(np.int8)


@dataclass(frozen=True, kw_only=True, eq=False)
class Plant:
    """One contact of one foot: frames start <= t < stop; HEEL before flat, BALL from roll on.

    start <= flat <= roll <= stop. heel, ball: (3,) where those sole points are held, on the ground.
    turn: (4,) world rotation of the flat sole frame (x along the foot, z the ground's normal).
    change: m, the largest move this asks of a pinned point.
    """

    foot: int
    start: int
    flat: int
    roll: int
    stop: int
    heel: Array
    ball: Array
    turn: Array
    normal: Array
    change: float


@dataclass(frozen=True, kw_only=True, eq=False)
class FootPaths:
    """Where the feet shall go, as offsets from the working clip: exactly 0 where nothing is asked.

    moves: (T, F, 3) m, of the ankle. turns: (T, F, 3) world rotation vectors, of the foot.
    toe_turns: (T, F, 3) likewise, of the toe joint after the foot's. pinned: (T, F) the frame is in
    a plant.
    """

    moves: Array
    turns: Array
    toe_turns: Array
    pinned: Bools


@dataclass(frozen=True, kw_only=True, eq=False)
class Working:
    """The clip as the rooms see it: its legs alone. back: (4,) turns its root offsets into the
    input's frame. pad: frames before frame 0. joints: (J,) which of the input's joints are in it.

    positions (N,J,3), rotations (N,J,4): model pose; soles (N,F,3,3) heel, ball, tip; N = T + 2
    pad. shift (N,3): what was added to the input's (levelled) root to take belt and floor height
    out. belt: (3,) m/s of what the feet stood on. closed: a padded clip's last frame is its first
    again; without, that would be the next one. contacts: as far as points alone tell them.
    """

    clip: Clip
    rig: Rig
    joints: Ints
    positions: Array
    rotations: Array
    soles: Array
    scale: float
    back: Array
    shift: Array
    belt: Array
    pad: int
    frames: int
    closed: bool = True
    contacts: Contacts | None = None
    notes: tuple[str, ...] = ()


@dataclass(frozen=True, kw_only=True, eq=False)
class Cleaned:
    """clip: the result. contacts, plants, phases: in its own frames. root_moves: (T, 3) m.
    work: the clip as cleanup saw it, before it; None for the preset "footplant". ground: the true
    one, where it was given. levelled: the floor's tilt is out of `clip`.

    report: what was found and done, of numbers, strings, lists and dicts alone.
    """

    clip: Clip
    rig: Rig
    contacts: Contacts
    plants: tuple[Plant, ...]
    phases: NDArray[np.int8]
    root_moves: Array
    work: Working | None = None
    ground: Ground | None = None
    levelled: bool = False
    report: dict[str, Any] = field(default_factory=dict)

    @property
    def held(self) -> Contacts:
        """When plants hold heel and toe: what curves are baked from.

        `contacts` may reach a little further, while a foot comes down or already leaves.
        """
        heel = (self.phases == Phase.HEEL) | (self.phases == Phase.FLAT)
        toe = (self.phases == Phase.BALL) | (self.phases == Phase.FLAT)
        return replace(self.contacts, down=np.stack([heel, toe], axis=-1))
