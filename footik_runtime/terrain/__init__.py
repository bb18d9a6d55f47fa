"""Terrain: uneven ground as MjSpec builders, seeded and composable.

`make_terrain("stairs").add_to(spec)` adds a named terrain; `Terrain(name=..., pieces=(...))` lays
pieces of your own one after another along x. World frame, metres; characters start at the origin
facing +x.
"""

from footik_runtime.terrain.belt import Belt
from footik_runtime.terrain.even import Flat, Gap, Ledge, Ramp, SideSlope, Stairs, Step
from footik_runtime.terrain.hills import Hills
from footik_runtime.terrain.layout import BEGIN, Terrain
from footik_runtime.terrain.named import TERRAINS, make_terrain
from footik_runtime.terrain.piece import FRICTION, TERRAIN_GROUP, Piece, Site
from footik_runtime.terrain.platform import Platform
from footik_runtime.terrain.scattered import Rubble, Stones

__all__ = [
    "BEGIN",
    "FRICTION",
    "TERRAINS",
    "TERRAIN_GROUP",
    "Belt",
    "Flat",
    "Gap",
    "Hills",
    "Ledge",
    "Piece",
    "Platform",
    "Ramp",
    "Rubble",
    "SideSlope",
    "Site",
    "Stairs",
    "Step",
    "Stones",
    "Terrain",
    "make_terrain",
]
