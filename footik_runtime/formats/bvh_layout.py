"""The layout of a BVH file: its channels in order, and what its numbers mean in our frame."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from footik_runtime.formats.bvh_text import numbers
from footik_runtime.formats.euler import euler_to_quaternions
from footik_runtime.formats.number_text import read_numbers
from footik_runtime.skeleton import Skeleton

Array = NDArray[np.float64]

# Where each axis of the file (x, y, z) lies among ours.
AXES = {"y": [1, 2, 0], "z": [0, 1, 2]}
BLOCK = 1024  # frames turned at once: what lies between angles and quaternions is five times both
_BROADCAST_RATES = (24000 / 1001, 30000 / 1001, 60000 / 1001, 120000 / 1001)


@dataclass(frozen=True, kw_only=True, eq=False)
class BvhLayout:
    """How a clip's file was laid out; kept in extras["bvh"] so that it can be written alike.

    Attributes:
        names, parents: the joints.
        channels: of each joint, in the file's order.
        offsets: of each joint, the text of its three numbers, in file axes and units.
        tips: joint index -> the text of its end site's offset.
        up: the file's up axis, "y" or "z".
        scale: metres a unit.
        frame_time: text, seconds.
        frames: how many whole frames `motion` begins with.
        motion: the text of the frames.
    """

    names: tuple[str, ...]
    parents: tuple[int, ...]
    channels: tuple[tuple[str, ...], ...]
    offsets: tuple[str, ...]
    tips: dict[int, str]
    up: str
    scale: float
    frame_time: str
    frames: int
    motion: bytes = field(repr=False)

    @property
    def width(self) -> int:
        """Values a frame."""
        return sum(map(len, self.channels))

    @property
    def fps(self) -> float:
        """Frames a second: the whole or broadcast rate the rounded text must mean, if one does."""
        rate = 1.0 / float(self.frame_time)
        for known in (*_BROADCAST_RATES, float(round(min(rate, 1e9)))):
            if abs(rate - known) <= 1e-4 * known:
                return known
        return rate

    def lengths(self, text: str) -> Array:
        """(3,) an offset's text in our frame, m."""
        out = np.empty(3)
        with np.errstate(over="ignore"):  # the skeleton refuses what is not finite
            out[AXES[self.up]] = numbers(text) * self.scale
        return out

    def skeleton(self) -> Skeleton:
        """The joints in our frame, m."""
        return Skeleton(
            names=self.names,
            parents=np.array(self.parents, dtype=np.int32),
            offsets=np.array([self.lengths(text) for text in self.offsets]),
            tips={joint: self.lengths(text) for joint, text in self.tips.items()},
        )

    def values(self) -> Array:
        """(frames, width) the numbers of `motion`, parsed again."""
        found, _ = read_numbers(self.motion)
        return found[: self.frames * self.width].reshape(self.frames, self.width)


@dataclass(frozen=True, kw_only=True)
class JointChannels:
    """Where a joint's channels stand in a frame: columns, and the axis each is about, in order."""

    place_columns: list[int]
    place_axes: list[int]
    turn_columns: list[int]
    turn_axes: tuple[int, ...]


def joint_channels(channels: tuple[tuple[str, ...], ...], up: str) -> Iterator[JointChannels]:
    """Each joint's channels, with their axes in our frame."""
    axes, column = AXES[up], 0
    for names in channels:
        own = [(column + n, axes["XYZ".index(name[0])], name) for n, name in enumerate(names)]
        column += len(names)
        places = [(c, a) for c, a, name in own if name.endswith("position")]
        turns = [(c, a) for c, a, name in own if name.endswith("rotation")]
        yield JointChannels(
            place_columns=[c for c, _ in places],
            place_axes=[a for _, a in places],
            turn_columns=[c for c, _ in turns],
            turn_axes=tuple(a for _, a in turns),
        )


def by_order(
    joints: list[JointChannels], chosen: list[int]
) -> Iterator[tuple[tuple[int, ...], list[int], NDArray[np.intp]]]:
    """Joints that share an order of rotations: the order, their indices, their columns (R, G)."""
    groups: dict[tuple[int, ...], list[int]] = {}
    for j in chosen:
        groups.setdefault(joints[j].turn_axes, []).append(j)
    for order, members in groups.items():
        columns = np.array([joints[j].turn_columns for j in members], dtype=np.intp)
        yield order, members, columns.T


def pose_arrays(layout: BvhLayout, values: Array) -> tuple[Array, Array, Array | None]:
    """Values (T, C) in our frame: root positions (T, 3), rotations (T, J, 4), translations."""
    frames, joints = len(values), list(joint_channels(layout.channels, layout.up))
    turns = np.empty((frames, len(joints), 4))
    for order, members, columns in by_order(joints, list(range(len(joints)))):
        for start in range(0, frames, BLOCK):
            angles = np.radians(values[start : start + BLOCK].T[columns])
            turns[start : start + BLOCK, members] = euler_to_quaternions(angles, order).T
    offsets = layout.skeleton().offsets
    with np.errstate(over="ignore"):  # the clip refuses what is not finite
        moved = {
            j: _placed(offsets[j], values[:, joint.place_columns] * layout.scale, joint.place_axes)
            for j, joint in enumerate(joints)
            if joint.place_columns or j == 0
        }
    places = moved.pop(0)
    if not moved:
        return places, turns, None
    moves = np.tile(offsets, (frames, 1, 1))
    for j, track in moved.items():
        moves[:, j] = track
    return places, turns, moves


def _placed(offset: Array, given: Array, axes: list[int]) -> Array:
    """(T, 3): the offset, with the axes that have channels replaced."""
    out = np.tile(offset, (len(given), 1))
    out[:, axes] = given
    return out
