"""Balance: where a character's centre of mass is over the feet that stand."""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from footik_runtime import quat_arrays
from footik_runtime.crowd import Crowd
from footik_runtime.feet.record import GROUNDED
from footik_runtime.scene import Scene

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, eq=False)
class Balance:
    """The centre of mass over the support.

    Attributes:
        com_w: (3,) the centre of mass, world, m.
        support_w: (N, 3) corners of the support, counter-clockwise seen from above, world, m: the
            convex hull of the soles that stand; none where no foot does.
        margin: m that the centre of mass is inside the support's nearest side, seen along what is
            up; below 0 how far it is outside. NaN without a support.
    """

    com_w: Array
    support_w: Array
    margin: float


def balance_over(scene: Scene, crowd: Crowd) -> Balance:
    """The balance of a scene's character, the first of its crowd, as its data stands now."""
    model, data = scene.model, scene.data
    mujoco.mj_comPos(model, data)
    com = data.subtree_com[scene.character.bodies[0]].copy()
    frame = crowd.frame
    corners = [
        _sole_corners(crowd, i)
        for i in range(crowd.feet.shape[1])
        if crowd.feet[0, i]["state"] == GROUNDED and crowd.feet[0, i]["weight"] >= 1.0
    ]
    if not corners:
        return Balance(com_w=com, support_w=np.zeros((0, 3)), margin=np.nan)
    hull = convex_hull(np.concatenate(corners))
    seen = quat_arrays.rotate(quat_arrays.conj(frame), com)
    return Balance(
        com_w=com, support_w=quat_arrays.rotate(frame, hull), margin=margin_in(hull, seen)
    )


def _sole_corners(crowd: Crowd, i: int) -> Array:
    """(6, 3) the corners of heel, ball and tip of one foot, in the crowd's frame."""
    foot, sole = crowd.feet[0, i], crowd.tables.legs[i]
    ends = (-sole["heel"], sole["ball"], sole["tip"])
    wide = sole["half_width"]
    local = np.array([[x, y, -sole["height"]] for x in ends for y in (wide, -wide)])
    return foot["out"] + quat_arrays.rotate(foot["out_turn"], local)


def convex_hull(points: Array) -> Array:
    """(N, 3) those of the points (P, 3) that are the corners of their hull, seen from above.

    Counter-clockwise, by Andrew's monotone chain.
    """
    order = points[np.lexsort((points[:, 1], points[:, 0]))]

    def chain(along: Array) -> list[Array]:
        out: list[Array] = []
        for point in along:
            while len(out) > 1 and _turn(out[-2], out[-1], point) <= 0.0:
                out.pop()
            out.append(point)
        return out[:-1]

    return np.array(chain(order) + chain(order[::-1]) or [points[0]])


def _turn(a: Array, b: Array, c: Array) -> float:
    return float((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]))


def margin_in(hull: Array, point: Array) -> float:
    """How far a point (3,) is inside a convex hull (N, 3), seen from above, m; outside below 0."""
    starts, ends = hull[:, :2], np.roll(hull[:, :2], -1, axis=0)
    ways = ends - starts
    lengths = np.maximum(np.hypot(*ways.T), 1e-12)
    to = point[:2] - starts
    inside = (ways[:, 0] * to[:, 1] - ways[:, 1] * to[:, 0]) / lengths
    if len(hull) > 2 and (inside >= 0.0).all():
        return float(inside.min())
    along = np.clip(np.sum(to * ways, axis=1) / lengths**2, 0.0, 1.0)
    return -float(np.hypot(*(to - along[:, None] * ways).T).min())
