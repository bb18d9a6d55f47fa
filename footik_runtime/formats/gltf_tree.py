"""glTF's nodes as joints: which nodes make the skeleton, and where each lies, in our frame.

glTF is right-handed, y up, facing +z. The cyclic permutation (x, y, z) -> (z, x, y) makes that our
z up, facing +x; it multiplies nothing, so it is exact.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from footik_runtime.errors import FootIKError, unknown_name
from footik_runtime.formats.glb_container import Gltf
from footik_runtime.quat_arrays import from_bone, mul, rotate

Array = NDArray[np.float64]

OURS = [2, 0, 1]  # file xyz -> ours
THEIRS = [1, 2, 0]  # ours -> file xyz
OURS_TURN = [3, 2, 0, 1]  # file quaternion xyzw -> ours wxyz
THEIRS_TURN = [2, 3, 1, 0]  # ours wxyz -> file xyzw
ALIKE = 1e-4  # scales so near to each other are one: exporters leave 0.9999998


@dataclass(frozen=True, kw_only=True, eq=False)
class Tree:
    """All N nodes of a file, in our axes and the file's unit.

    Attributes:
        parents: of each node, -1 at the top.
        order: all nodes, parents before children, the children of a node in its order.
        names: unique.
        moves: (N, 3) rest translations.
        turns: (N, 4) rest rotations, unit, wxyz.
        scales: (N,) rest scales; the geometric mean where the three differ.
        notes: what is odd about them, a sentence each.
    """

    parents: list[int]
    order: list[int]
    names: list[str]
    moves: Array
    turns: Array
    scales: Array
    notes: tuple[str, ...]

    def line(self, node: int) -> list[int]:
        """The node and its ancestors, up to the top."""
        found = [node]
        while self.parents[found[-1]] >= 0:
            found.append(self.parents[found[-1]])
        return found


@dataclass(frozen=True, kw_only=True, eq=False)
class Joints:
    """The J nodes that are joints.

    Attributes:
        nodes: of each joint; joint 0 is above all.
        parents: (J,) joint indices.
        names: of each joint.
        move, turn: (3,) m and (4,) of the frame that joint 0 lies in: its still ancestors.
        scales: (J,) metres a unit of each joint's translation.
    """

    nodes: tuple[int, ...]
    parents: NDArray[np.int32]
    names: tuple[str, ...]
    move: Array
    turn: Array
    scales: Array


def read_tree(gltf: Gltf) -> Tree:
    """All nodes of a file. Raises FootIKError where they are no trees."""
    nodes = gltf.items("nodes")
    count = len(nodes)
    if not count:
        gltf.fail("the file has no nodes, so no skeleton")
    moves, turns, scales = np.zeros((count, 3)), np.zeros((count, 4)), np.ones((count, 3))
    turns[:, 0] = 1.0
    for n in range(count):
        moves[n], turns[n], scales[n] = placed(gltf, n)
    parents, order = _family(gltf, count)
    names = _names(gltf, count)
    sizes = np.abs(scales)
    good = np.asarray((sizes > 1e-9).all(axis=1))
    mean = np.cbrt(np.prod(np.where(good[:, None], sizes, 1.0), axis=1))
    mean[np.abs(mean - 1.0) < ALIKE] = 1.0
    notes = []
    odd = [
        ("a scale of zero, which is taken as 1", ~good),
        ("a mirroring scale, whose sign is left out", good & (scales < 0.0).any(axis=1)),
        (
            "another scale along each axis; their mean is taken",
            good & (np.ptp(sizes, axis=1) > 10 * ALIKE * sizes.max(axis=1)),
        ),
    ]
    for what, bad in odd:
        for n in np.flatnonzero(np.asarray(bad))[:1]:
            notes.append(f"Node {names[n]!r} has {what}.")
    return Tree(
        parents=parents,
        order=order,
        names=names,
        moves=moves,
        turns=turns,
        scales=mean,
        notes=tuple(notes),
    )


def placed(gltf: Gltf, n: int) -> tuple[Array, Array, Array]:
    """Rest translation (3,), rotation (4,) and scale (3,) of one node, in our axes."""
    node, where = gltf.item("nodes", n), f"nodes[{n}]"
    matrix = gltf.numbers(node, "matrix", 16, where)
    if matrix is not None:
        columns = matrix.reshape(4, 4)[:3, :3][OURS][:, OURS]
        scale = np.linalg.norm(columns, axis=1)
        if np.linalg.det(columns) < 0.0:
            scale[0] = -scale[0]
        turn = np.array([1.0, 0.0, 0.0, 0.0])
        if (np.abs(scale) > 1e-9).all():
            _, y, z = columns / scale[:, None]
            turn = from_bone(z, y) if np.linalg.norm(np.cross(y, z)) > 1e-6 else turn
        return matrix[12:15][OURS], turn, scale
    move = gltf.numbers(node, "translation", 3, where)
    turn = gltf.numbers(node, "rotation", 4, where)
    scale = gltf.numbers(node, "scale", 3, where)
    turn = np.array([0.0, 0.0, 0.0, 1.0]) if turn is None else turn
    length = float(np.linalg.norm(turn))
    if length < 1e-6:
        gltf.fail(f"the rotation of {where} has zero length")
    return (
        np.zeros(3) if move is None else move[OURS],
        turn[OURS_TURN] / length,
        np.ones(3) if scale is None else scale[OURS],
    )


def _family(gltf: Gltf, count: int) -> tuple[list[int], list[int]]:
    """Parents of all nodes, and an order with parents first. FootIKError for what is no tree."""
    parents = [-1] * count
    children: list[list[int]] = []
    for n in range(count):
        listed = gltf.get(gltf.item("nodes", n), "children", list, f"nodes[{n}]", [])
        for child in listed:
            if type(child) is not int or not 0 <= child < count:
                gltf.fail(f"nodes[{n}] has a child {str(child)[:20]}; there are {count} nodes")
            if parents[child] >= 0:
                gltf.fail(f"nodes[{child}] is a child of nodes[{parents[child]}] and nodes[{n}]")
            parents[child] = n
        children.append(listed)
    order, waiting = [], [n for n in range(count - 1, -1, -1) if parents[n] < 0]
    while waiting:
        order.append(waiting.pop())
        waiting += children[order[-1]][::-1]
    if len(order) < count:
        gltf.fail(f"nodes[{min(set(range(count)) - set(order))}] is its own ancestor")
    return parents, order


def _names(gltf: Gltf, count: int) -> list[str]:
    """The nodes' names; "node_7" where there is none, "name#7" where one was there before."""
    names, seen = [], set()
    for n in range(count):
        name = gltf.get(gltf.item("nodes", n), "name", str, f"nodes[{n}]", "") or f"node_{n}"
        while name in seen:
            name = f"{name}#{n}"
        seen.add(name)
        names.append(name)
    return names


def skin_joints(gltf: Gltf, skin: str | int | None) -> list[int]:
    """The nodes of a skin: the given one, else the largest and those that share nodes with it."""
    skins: list[list[int]] = []
    for s in range(len(gltf.items("skins"))):
        held = gltf.get(gltf.item("skins", s), "joints", list, f"skins[{s}]")
        for node in held:
            if type(node) is not int or not 0 <= node < len(gltf.items("nodes")):
                gltf.fail(f"skins[{s}] has a joint {str(node)[:20]}, which is no node")
        skins.append(held)
    if skin is not None:
        return skins[_chosen_skin(gltf, skin, len(skins))]
    if not skins:
        return []
    base = set(max(skins, key=len))
    for held in skins:
        if not base.isdisjoint(held):
            base.update(held)
    return sorted(base)


def _chosen_skin(gltf: Gltf, skin: str | int, count: int) -> int:
    names = [str(gltf.item("skins", s).get("name", f"skin_{s}")) for s in range(count)]
    if isinstance(skin, str) and skin in names:
        return names.index(skin)
    if isinstance(skin, str):
        raise FootIKError(f"{gltf.path.name}: {unknown_name('skin', skin, names)}")
    if not 0 <= skin < count:
        gltf.fail(f"skin {skin} is asked for, but the file has {count}")
    return skin


def choose_joints(
    gltf: Gltf, tree: Tree, skin: str | int | None, animated: Iterable[int]
) -> tuple[list[int], list[str]]:
    """The nodes that are joints, parents first, and notes.

    They are those of the skin, all animated ones below and above, and what lies between. Without a
    skin, the animated nodes of the tree that has most of them.
    """
    moving = set(animated)
    base = set(skin_joints(gltf, skin)) or _largest_family(tree, moving)
    if not base:
        gltf.fail("the file has neither a skin nor an animated node, so no skeleton")
    root = _common(tree, base)
    if root < 0:
        gltf.fail("the joints of the skin have no common ancestor")
    root = [n for n in tree.line(root) if n == root or n in moving][-1]
    below = {root}
    for n in tree.order:
        if tree.parents[n] in below:
            below.add(n)
    wanted = {root}
    for n in reversed(tree.order):
        if n in below and n != root and (n in base or n in moving or n in wanted):
            wanted.update((n, tree.parents[n]))
    outside = sorted(moving - wanted)
    notes = []
    if outside:
        notes.append(
            f"{len(outside)} animated nodes, such as {tree.names[outside[0]]!r}, are no part of "
            "the skeleton and stay as they are."
        )
    by_index = sorted(wanted)
    ordered = all(tree.parents[n] < n for n in by_index if n != root)
    return by_index if ordered else [n for n in tree.order if n in wanted], notes


def _largest_family(tree: Tree, nodes: set[int]) -> set[int]:
    top: dict[int, int] = {}
    for n in tree.order:
        top[n] = n if tree.parents[n] < 0 else top[tree.parents[n]]
    families: dict[int, set[int]] = {}
    for n in sorted(nodes):
        families.setdefault(top[n], set()).add(n)
    return max(families.values(), key=len, default=set())


def _common(tree: Tree, nodes: set[int]) -> int:
    """The lowest node that all of these descend from, or are; -1 where there is none."""
    held = [int(n in nodes) for n in range(len(tree.parents))]
    for n in reversed(tree.order):
        if held[n] == len(nodes):
            return n
        if tree.parents[n] >= 0:
            held[tree.parents[n]] += held[n]
    return -1


def place_joints(tree: Tree, nodes: list[int], scales: Array, unit: float) -> Joints:
    """The joints, with what their still ancestors do to them.

    Args:
        tree: all nodes.
        nodes: of the joints, parents first.
        scales: (N,) of all nodes: those of the animation where it has some.
        unit: metres a unit of the file.
    """
    move, turn, scale = np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0]), unit
    for n in reversed(tree.line(nodes[0])[1:]):
        move = move + rotate(turn, scale * tree.moves[n])
        turn = mul(turn, tree.turns[n])
        scale *= scales[n]
    index = {n: j for j, n in enumerate(nodes)}
    metres = np.full(len(nodes), scale)
    for j, n in enumerate(nodes[1:], start=1):
        parent = tree.parents[n]
        metres[j] = metres[index[parent]] * scales[parent]
    if not (metres.min() > 1e-12 and metres.max() < 1e12):
        raise FootIKError(
            f"the scales above joint {tree.names[nodes[int(np.argmin(metres))]]!r} multiply to "
            f"{metres.min():g}; 1e-12 to 1e12 are read."
        )
    return Joints(
        nodes=tuple(nodes),
        parents=np.array([-1] + [index[tree.parents[n]] for n in nodes[1:]], dtype=np.int32),
        names=tuple(tree.names[n] for n in nodes),
        move=move,
        turn=turn,
        scales=metres,
    )
