"""The terrains that have a name: what each is made of, and `make_terrain`."""

from __future__ import annotations

import inspect
import itertools
from collections.abc import Callable, Sequence
from typing import Any

from footik_runtime.errors import unknown_name
from footik_runtime.terrain.even import Flat, Gap, Ledge, Ramp, Stairs, Step
from footik_runtime.terrain.hills import Hills
from footik_runtime.terrain.layout import BEGIN, Terrain
from footik_runtime.terrain.piece import Piece, check_setting
from footik_runtime.terrain.platform import Platform
from footik_runtime.terrain.scattered import Rubble, Stones

_REACH = 31.0  # m of x: 20 s at 1.5 m/s, and some
_OUT_RUN = 2.0  # m of level ground after the last piece


def flat(*, seed: int = 0) -> Terrain:
    """Level ground throughout."""
    return Terrain(name="flat", pieces=(Flat(length=_REACH + _OUT_RUN - BEGIN),), seed=seed)


def slope(*, angle_deg: float = 15.0, seed: int = 0) -> Terrain:
    """Up a ramp, over a level top, down a ramp, again and again."""
    check_setting("slope angle_deg", angle_deg, (0.0, 45.0))
    up, down = Ramp(angle_deg=angle_deg), Ramp(angle_deg=-angle_deg)
    return _repeated("slope", (up, Flat(), down, Flat()), seed)


def stairs(
    *,
    steps: int = 12,
    step_height: float = 0.17,
    step_depth: float = 0.30,
    landing: float = 1.8,
    seed: int = 0,
) -> Terrain:
    """A flight up, a landing, a flight down, level ground, again and again."""
    check_setting("stairs landing", landing, (0.05, 1000.0))
    step = {"steps": steps, "step_height": step_height, "step_depth": step_depth}
    cycle = (Stairs(**step), Flat(length=landing), Stairs(**step, down=True), Flat(length=landing))
    return _repeated("stairs", cycle, seed)


def hills(*, amplitude: float = 0.25, wavelength: float = 6.0, seed: int = 0) -> Terrain:
    """Smooth hills, level within a metre of the start."""
    piece = Hills(length=_REACH - 1.0, amplitude=amplitude, wavelength=wavelength)
    return _repeated("hills", (piece,), seed)


def rubble(*, tilt_deg: float = 6.0, seed: int = 0) -> Terrain:
    """Tilted blocks on a floor, none within a metre of the start."""
    return _repeated("rubble", (Rubble(length=_REACH - 1.0, tilt_deg=tilt_deg),), seed)


def stones(*, height_change: float = 0.04, depth: float = 0.5, seed: int = 0) -> Terrain:
    """Stepping stones over pits, with level ground between."""
    cycle = (Stones(height_change=height_change, depth=depth), Flat(length=1.5))
    return _repeated("stones", cycle, seed)


def ledge(*, drop: float = 0.20, seed: int = 0) -> Terrain:
    """An edge along the way, left foot high and right foot low; then steps across it."""
    cycle = (Ledge(drop=drop), Flat(length=1.5), Step(height_change=drop), Flat(length=2.5))
    return _repeated("ledge", cycle, seed)


def gap(*, width: float = 0.25, depth: float = 0.6, seed: int = 0) -> Terrain:
    """Gaps across the way, with level ground between."""
    return _repeated("gap", (Gap(width=width, depth=depth), Flat(length=1.9)), seed)


def platform(
    *,
    lift: float = 0.08,
    turn_deg: float = 20.0,
    tilt_deg: float = 3.0,
    period: float = 6.0,
    seed: int = 0,
) -> Terrain:
    """Slabs that travel, lift, turn and tilt."""
    piece = Platform(lift=lift, turn_deg=turn_deg, tilt_deg=tilt_deg, period=period)
    return _repeated("platform", (piece,), seed)


def course(*, seed: int = 0) -> Terrain:
    """Some of everything, one after another."""
    rest = Flat(length=1.2)
    parts: list[Sequence[Piece]] = [
        (Ramp(angle_deg=12.0, length=2.5), rest, Stairs(steps=4), rest),
        (Hills(length=6.0, amplitude=0.15, wavelength=4.0, blend=1.5),),
        (rest, Stairs(steps=4, down=True), rest, Ledge(length=2.0), Step(), rest),
        (Rubble(length=4.0), rest, Gap(), rest, Stones(length=2.4), rest, Platform(length=5.0)),
    ]
    return _repeated("course", tuple(itertools.chain.from_iterable(parts)), seed)


TERRAINS: dict[str, Callable[..., Terrain]] = {
    maker.__name__: maker
    for maker in (flat, slope, stairs, hills, rubble, stones, ledge, gap, platform, course)
}
"""Every named terrain: name -> maker, taking `seed` and settings of its own as keywords."""


def make_terrain(name: str, *, seed: int = 0, **settings: Any) -> Terrain:
    """The terrain of that name. Raises FootIKError for an unknown name or setting, or a bad value.

    Example: make_terrain("slope", angle_deg=20.0).
    """
    if not isinstance(name, str) or name not in TERRAINS:
        raise unknown_name("terrain", str(name), TERRAINS)
    maker = TERRAINS[name]
    known = inspect.signature(maker).parameters
    for setting in settings:
        if setting not in known:
            raise unknown_name(f"setting of terrain {name!r}", setting, known)
    return maker(seed=seed, **settings)


def _repeated(name: str, cycle: tuple[Piece, ...], seed: int) -> Terrain:
    """A level run-in to x = 1, the cycle until it reaches far enough, and a level out-run."""
    pieces: list[Piece] = [Flat(length=1.0 - BEGIN)]
    reached = 1.0
    while reached < _REACH:
        pieces.extend(cycle)
        reached += sum(piece.span for piece in cycle)
    return Terrain(name=name, pieces=(*pieces, Flat(length=_OUT_RUN)), seed=seed)
