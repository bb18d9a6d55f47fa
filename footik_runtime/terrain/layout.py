"""Terrain: pieces laid one after another along x, each beginning at the height the last ended."""

from __future__ import annotations

import functools
from dataclasses import dataclass
from numbers import Real

import mujoco
import numpy as np
from numpy.typing import ArrayLike

from footik_runtime.errors import FootIKError
from footik_runtime.terrain.look import add_look, has_look
from footik_runtime.terrain.piece import Array, Piece, Site, check_setting

BEGIN = -4.0
"""World x at which every terrain begins, m: the start is at x = 0."""

_UNDERGROUND = 0.5  # m that solid ground reaches below the lowest ground there is


@dataclass(frozen=True, kw_only=True)
class Terrain:
    """Ground for a character that starts at the origin and walks along x.

    Attributes:
        name: what to call it.
        pieces: laid from x = -4 on; the first is level and reaches past the origin.
        seed: of everything random in it; piece i draws from (seed, i).
        half_width: m, the ground spans y from -half_width to half_width.
    """

    name: str
    pieces: tuple[Piece, ...]
    seed: int = 0
    half_width: float = 5.0

    def __post_init__(self) -> None:
        check_setting("terrain seed", self.seed, (0, 2**63 - 1))
        check_setting("terrain half_width", self.half_width, (0.5, 1000.0))
        pieces = self.pieces
        if not isinstance(pieces, (tuple, list)) or not all(isinstance(p, Piece) for p in pieces):
            raise FootIKError(f"terrain {self.name!r} needs a tuple of pieces, not {pieces!r}.")
        if not pieces:
            raise FootIKError(f"terrain {self.name!r} needs at least one piece.")

    @property
    def start_w(self) -> Array:
        """(3,) where a character starts, on the ground, facing +x."""
        return np.zeros(3)

    @property
    def extent(self) -> tuple[float, float, float, float]:
        """World x_min, x_max, y_min, y_max of the ground, m."""
        end = self.sites[-1].x + self.pieces[-1].span
        return BEGIN, end, -self.half_width, self.half_width

    @functools.cached_property
    def static(self) -> bool:
        """Whether nothing of it ever moves, so that `move` need not be called."""
        return all(piece.static for piece in self.pieces)

    @functools.cached_property
    def sites(self) -> tuple[Site, ...]:
        """Where each piece lies."""
        spans, rises = ([getattr(p, part) for p in self.pieces] for part in ("span", "rise"))
        begins = BEGIN + np.concatenate([[0.0], np.cumsum(spans)])
        levels = np.concatenate([[0.0], np.cumsum(rises)])
        lows = [level + p.lowest for level, p in zip(levels, self.pieces, strict=False)]
        base = min(lows) - _UNDERGROUND
        return tuple(
            Site(
                name=f"terrain_{i:02d}_{type(piece).__name__.lower()}",
                x=float(begins[i]),
                z=float(levels[i]),
                base=float(base),
                half_width=self.half_width,
                seed=(int(self.seed), i),
            )
            for i, piece in enumerate(self.pieces)
        )

    def add_to(self, spec: mujoco.MjSpec) -> None:
        """Add all geoms, bodies, materials, sun and sky. Raises FootIKError if one is there."""
        if has_look(spec):
            raise FootIKError(f"cannot add terrain {self.name!r}: the spec has a terrain already.")
        add_look(spec)
        for piece, site in zip(self.pieces, self.sites, strict=True):
            piece.build(spec, site)

    def move(self, model: mujoco.MjModel, data: mujoco.MjData, time: float) -> None:
        """Set the mocap poses of moving pieces to those at `time` s; static terrain does nothing.

        The geoms follow at the next mj_kinematics, mj_forward or mj_step.
        """
        if not (isinstance(time, Real) and np.isfinite(time)):
            raise FootIKError(f"terrain time must be finite, not {time!r}.")
        for piece, site in zip(self.pieces, self.sites, strict=True):
            piece.move(model, data, site, time)

    def height(self, x: ArrayLike, y: ArrayLike) -> Array:
        """World height of the ground at world x, y (any shapes that broadcast), m.

        NaN beyond the extent, and where only rays know it: on rubble, stepping stones and moving
        platforms. On an edge between two pieces it is the later one's.
        """
        try:
            x, y = np.broadcast_arrays(np.asarray(x, np.float64), np.asarray(y, np.float64))
        except (TypeError, ValueError) as error:
            raise FootIKError(f"x and y must be numbers of one shape: {error}.") from None
        x_min, x_max, y_min, y_max = self.extent
        inside = (x >= x_min) & (x <= x_max) & (y >= y_min) & (y <= y_max)
        which = np.searchsorted([site.x for site in self.sites], x, side="right") - 1
        out = np.full(x.shape, np.nan)
        for i, (piece, site) in enumerate(zip(self.pieces, self.sites, strict=True)):
            here = inside & (which == i)
            if here.any():
                out[here] = site.z + piece.height(site, x[here] - site.x, y[here])
        return out
