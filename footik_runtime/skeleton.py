"""Skeleton: a tree of joints with fixed offsets; forward kinematics over it.

Right-handed, z up, metres. A joint's local rotation is relative to its parent's frame; its local
translation is the joint's place in that frame. The first joint is the only root.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from footik_runtime.compiled import compiled
from footik_runtime.errors import FootIKError, unknown_name
from footik_runtime.math3d import add, get3, get4, quat_mul, rotate, set3, set4

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, eq=False)
class Skeleton:
    """Names, parents and rest offsets of J joints, parents before children.

    Attributes:
        names: unique joint names.
        parents: (J,) int32, the parent's index; -1 for joint 0 alone.
        offsets: (J, 3) rest translation in the parent's frame, m.
        rest_rotations: (J, 4) rest rotation in the parent's frame, wxyz; identities by default.
        tips: joint index -> offset (3,) of a leaf's far end in its own frame, m (a BVH end site).
    """

    names: tuple[str, ...]
    parents: NDArray[np.int32]
    offsets: Array
    rest_rotations: Array = field(default_factory=lambda: np.zeros((0, 4)))
    tips: dict[int, Array] = field(default_factory=dict)

    def __post_init__(self) -> None:
        joints = len(self.names)
        set_field = object.__setattr__
        set_field(self, "parents", np.ascontiguousarray(self.parents, dtype=np.int32))
        set_field(self, "offsets", np.ascontiguousarray(self.offsets, dtype=np.float64))
        rest = np.asarray(self.rest_rotations, dtype=np.float64)
        if rest.size == 0:
            rest = np.tile([1.0, 0.0, 0.0, 0.0], (joints, 1))
        set_field(self, "rest_rotations", np.ascontiguousarray(rest))
        if joints == 0:
            raise FootIKError("a skeleton needs at least one joint.")
        if len(set(self.names)) != joints:
            twice = sorted({n for n in self.names if self.names.count(n) > 1})
            raise FootIKError(f"joint names must be unique; these are not: {', '.join(twice)}.")
        if self.parents.shape != (joints,) or self.offsets.shape != (joints, 3):
            raise FootIKError(
                f"{joints} joints need parents ({joints},) and offsets ({joints}, 3), "
                f"not {self.parents.shape} and {self.offsets.shape}."
            )
        if rest.shape != (joints, 4):
            raise FootIKError(f"rest_rotations must be ({joints}, 4), not {rest.shape}.")
        for joint, parent in enumerate(self.parents):
            if not (parent == -1 if joint == 0 else 0 <= parent < joint):
                raise FootIKError(
                    f"joint {self.names[joint]!r} (index {joint}) has parent {parent}; joint 0 is "
                    "the only root (-1), and every other parent comes before its child."
                )
        if not np.isfinite(self.offsets).all():
            bad = self.names[int(np.argwhere(~np.isfinite(self.offsets))[0, 0])]
            raise FootIKError(f"the offset of joint {bad!r} is not finite.")
        if not np.isfinite(rest).all():
            bad = self.names[int(np.argwhere(~np.isfinite(rest))[0, 0])]
            raise FootIKError(f"the rest rotation of joint {bad!r} is not finite.")

    def __len__(self) -> int:
        return len(self.names)

    @cached_property
    def _index(self) -> dict[str, int]:
        return {name: i for i, name in enumerate(self.names)}

    def index(self, name: str) -> int:
        """The index of a joint. Raises FootIKError, with the nearest name, where there is none."""
        try:
            return self._index[name]
        except KeyError:
            raise unknown_name("joint", name, self.names) from None

    def children(self, joint: int) -> list[int]:
        """Indices of a joint's children, in order."""
        return [int(c) for c in np.flatnonzero(self.parents == joint)]

    def chain(self, joint: int) -> list[int]:
        """The joint and its ancestors up to the root."""
        line = [joint]
        while self.parents[line[-1]] >= 0:
            line.append(int(self.parents[line[-1]]))
        return line

    def only(self, joints: Sequence[int]) -> Skeleton:
        """Some joints alone, in order: the root, and none without its parent."""
        place = {int(joint): i for i, joint in enumerate(joints)}
        return Skeleton(
            names=tuple(self.names[j] for j in joints),
            parents=np.array([place.get(int(self.parents[j]), -1) for j in joints], dtype=np.int32),
            offsets=self.offsets[list(joints)],
            rest_rotations=self.rest_rotations[list(joints)],
            tips={place[j]: tip for j, tip in self.tips.items() if j in place},
        )

    @staticmethod
    def _require_shape(what: str, value: Array, shape: tuple[int, ...]) -> None:
        if np.shape(value) != shape:
            raise FootIKError(f"{what} must be {shape}, not {np.shape(value)}.")

    def rest_pose(self) -> tuple[Array, Array]:
        """Rest positions (J, 3) and rotations (J, 4) in the model frame."""
        positions, rotations = self.forward(self.rest_rotations[None], self.offsets[0][None])
        return positions[0], rotations[0]

    def forward(
        self, rotations: Array, root_positions: Array, translations: Array | None = None
    ) -> tuple[Array, Array]:
        """Forward kinematics of N poses.

        Args:
            rotations: (N, J, 4) local, wxyz.
            root_positions: (N, 3) of joint 0, m.
            translations: (N, J, 3) local, m; the skeleton's offsets where None. Row 0 is ignored.

        Returns:
            Positions (N, J, 3) and rotations (N, J, 4), in the frame the root is given in.

        Raises:
            FootIKError: an array of another shape.
        """
        rotations = np.ascontiguousarray(rotations, dtype=np.float64)
        frames = len(rotations)
        moves = np.zeros((0, len(self), 3)) if translations is None else translations
        # Compiled code would read past the end of an array that is too short.
        self._require_shape("rotations", rotations, (frames, len(self), 4))
        self._require_shape("root_positions", root_positions, (frames, 3))
        if translations is not None:
            self._require_shape("translations", translations, (frames, len(self), 3))
        out_positions = np.empty((frames, len(self), 3))
        out_rotations = np.empty((frames, len(self), 4))
        _forward_frames(
            self.parents,
            self.offsets,
            np.ascontiguousarray(moves, dtype=np.float64),
            rotations,
            np.ascontiguousarray(root_positions, dtype=np.float64),
            out_positions,
            out_rotations,
        )
        return out_positions, out_rotations


@compiled
def forward_pose(parents, translations, rotations, root_position, positions_out, rotations_out):
    """FK of one pose: local translations (J, 3) and rotations (J, 4) to positions and rotations."""
    set3(positions_out[0], root_position)
    set4(rotations_out[0], get4(rotations[0]))
    for j in range(1, parents.shape[0]):
        p = parents[j]
        turn = get4(rotations_out[p])
        set4(rotations_out[j], quat_mul(turn, get4(rotations[j])))
        set3(positions_out[j], add(get3(positions_out[p]), rotate(turn, get3(translations[j]))))


@compiled
def _forward_frames(parents, offsets, moves, rotations, roots, positions_out, rotations_out):
    for f in range(rotations.shape[0]):
        local = moves[f] if moves.shape[0] else offsets
        forward_pose(
            parents, local, rotations[f], get3(roots[f]), positions_out[f], rotations_out[f]
        )
