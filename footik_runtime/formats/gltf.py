"""glTF: read one animation of a .glb or .gltf file into a Clip.

The clip's joints are the skin's, with all animated nodes below and above them; joint 0 is the
lowest node above them all. Still ancestors of it, such as an "Armature" that turns z up into y up,
are folded into the root. Rest is where the nodes are without animation. Lengths are metres, as
glTF says, unless the skeleton is far too large for that.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from footik_runtime.clip import Clip
from footik_runtime.errors import FootIKError, unknown_name
from footik_runtime.formats.glb_container import Gltf, read_container
from footik_runtime.formats.gltf_curves import CURVES, LOOP, TIP, read_curves
from footik_runtime.formats.gltf_tracks import (
    Grid,
    Track,
    find_grid,
    key_values,
    read_tracks,
    require_rate,
    sample,
)
from footik_runtime.formats.gltf_tree import (
    OURS,
    OURS_TURN,
    Joints,
    Tree,
    choose_joints,
    place_joints,
    read_tree,
)
from footik_runtime.offline.curve_keys import CURVE_KEYS
from footik_runtime.quat_arrays import mul, rotate
from footik_runtime.skeleton import Skeleton

__all__ = ["GltfSource", "animation_names", "names_in", "read_animations", "read_gltf"]

Array = NDArray[np.float64]

LARGEST = 20.0  # m, of all joints at rest: what is larger is not in metres
STEADY = 2.0**-22  # of the skeleton's size: a few float32 steps; moving less is being at rest


@dataclass(frozen=True, kw_only=True, eq=False)
class GltfSource:
    """Where a clip came from; kept in extras["gltf"] so that it can be written back.

    Attributes:
        gltf: the file.
        animation: index of the one that was read.
        joints: the nodes of the clip's joints.
        grid: the frames, in the file's time.
        tracks: (joint, "rotation" | "translation") -> its channel, where it has one.
        root_positions, rotations, translations, curves, loop: of the clip as it was read, to tell
            what has changed.
    """

    gltf: Gltf = field(repr=False)
    animation: int
    joints: Joints = field(repr=False)
    grid: Grid
    tracks: dict[tuple[int, str], Track] = field(repr=False)
    root_positions: Array = field(repr=False)
    rotations: Array = field(repr=False)
    translations: Array | None = field(repr=False)
    curves: dict[str, Array] = field(repr=False)
    loop: bool


def animation_names(path: str | os.PathLike[str]) -> list[str]:
    """The names of a file's animations, in order: unique, "animation_2" for one without a name."""
    return names_in(read_container(path))


def read_gltf(
    path: str | os.PathLike[str],
    *,
    animation: str | int | None = None,
    skin: str | int | None = None,
    fps: float | None = None,
    scale: float | None = None,
) -> Clip:
    """Read one animation of a .glb or .gltf file.

    Args:
        path: the file.
        animation: its name or index; the first one where None.
        skin: name or index of the skin whose joints are wanted; the largest where None.
        fps: frames a second; where None, those at which the file has its keys.
        scale: metres a unit; where None, 1 unless the skeleton is over 20 m then.

    Returns:
        The clip, in metres, z up, facing as the file does (its +z is our +x). `extras["gltf"]` is
        its GltfSource; `extras["notes"]` lists, a sentence each, what was guessed or left out.

    Raises:
        FootIKError: the file is missing, broken or compressed, or has no such animation or skin.
    """
    _require(fps, scale)
    gltf = read_container(path)
    index = _chosen(gltf, animation)
    return _clip(gltf, read_tree(gltf), index, names_in(gltf)[index], skin, fps, scale)


def read_animations(
    path: str | os.PathLike[str],
    *,
    skin: str | int | None = None,
    fps: float | None = None,
    scale: float | None = None,
) -> Iterator[Clip]:
    """All animations of a file, one after the other; arguments and errors as in `read_gltf`."""
    _require(fps, scale)
    gltf = read_container(path)
    _chosen(gltf, None)
    tree = read_tree(gltf)
    for index, name in enumerate(names_in(gltf)):
        yield _clip(gltf, tree, index, name, skin, fps, scale)


def _require(fps: float | None, scale: float | None) -> None:
    require_rate(fps)
    if scale is not None and not (np.isfinite(scale) and scale > 0.0):
        raise FootIKError(f"scale must be positive and finite, in metres a unit, not {scale}.")


def names_in(gltf: Gltf) -> list[str]:
    """The names of a document's animations, as `animation_names` has them."""
    names: list[str] = []
    seen: set[str] = set()
    for a in range(len(gltf.items("animations"))):
        name = gltf.get(gltf.item("animations", a), "name", str, f"animations[{a}]", "")
        name = name or f"animation_{a}"
        while name in seen:
            name = f"{name}#{a}"
        seen.add(name)
        names.append(name)
    return names


def _chosen(gltf: Gltf, animation: str | int | None) -> int:
    names = names_in(gltf)
    if not names:
        gltf.fail("the file holds no animation")
    if animation is None:
        return 0
    if isinstance(animation, str):
        if animation in names:
            return names.index(animation)
        if not animation.isdecimal() or len(animation) > 9:
            raise FootIKError(f"{gltf.path.name}: {unknown_name('animation', animation, names)}")
        animation = int(animation)
    if not 0 <= animation < len(names):
        gltf.fail(f"animation {animation} is asked for; the file has 0 to {len(names) - 1}")
    return animation


def _clip(
    gltf: Gltf,
    tree: Tree,
    index: int,
    name: str,
    skin: str | int | None,
    fps: float | None,
    scale: float | None,
) -> Clip:
    with np.errstate(all="ignore"):  # the skeleton and the clip refuse what is not finite
        return _read_clip(gltf, tree, index, name, skin, fps, scale)


def _read_clip(
    gltf: Gltf,
    tree: Tree,
    index: int,
    name: str,
    skin: str | int | None,
    fps: float | None,
    scale: float | None,
) -> Clip:
    tracks = read_tracks(gltf, index)
    nodes, notes = choose_joints(gltf, tree, skin, {track.node for track in tracks})
    joint = {node: j for j, node in enumerate(nodes)}
    own = [track for track in tracks if track.node in joint]
    if not own:
        gltf.fail(f"animation {name!r} moves no joint")
    scales, words = _scales(gltf, tree, own)
    notes = [*tree.notes, *notes, *words]
    joints = place_joints(tree, nodes, scales, scale or 1.0)
    if scale is None and (unit := _unit(tree, joints, notes)) != 1.0:
        joints = place_joints(tree, nodes, scales, unit)
    moving = [track for track in own if track.path != "scale"]
    grid = find_grid(gltf, moving or own, len(nodes), fps)
    if not grid.exact:
        notes.append(f"The keys lie on no even frames: sampled {grid.fps:.6g} times a second.")
    held = {(joint[t.node], t.path): t for t in moving}
    skeleton = _skeleton(gltf, tree, joints)
    extras = gltf.item("animations", index).get("extras")
    extras = extras if isinstance(extras, dict) else {}
    places, turns, moves = _arrays(gltf, skeleton, joints, held, grid, tree.turns[nodes])
    curves, keys = read_curves(gltf, extras.get(CURVES), grid)
    try:
        clip = Clip(
            skeleton=skeleton,
            fps=grid.fps,
            root_positions=places,
            rotations=turns,
            translations=moves,
            curves=curves,
            loop=extras.get(LOOP) is True,
            name=name if "name" in gltf.item("animations", index) else gltf.path.stem,
            extras={"notes": notes, **({CURVE_KEYS: keys} if keys else {})},
        )
    except FootIKError as error:
        raise FootIKError(f"{gltf.path.name}: {error}") from None
    clip.extras["gltf"] = GltfSource(
        gltf=gltf,
        animation=index,
        joints=joints,
        grid=grid,
        tracks=held,
        root_positions=clip.root_positions,
        rotations=clip.rotations,
        translations=clip.translations,
        curves=dict(clip.curves),
        loop=clip.loop,
    )
    return clip


def _scales(gltf: Gltf, tree: Tree, tracks: list[Track]) -> tuple[Array, list[str]]:
    """(N,) scales of all nodes, an animation's first where it has some, and what to know."""
    scales, moving = tree.scales.copy(), []
    for track in tracks:
        if track.path != "scale":
            continue
        values = np.abs(key_values(gltf, track).reshape(-1, 3))
        if track.interpolation == "CUBICSPLINE":
            values = values[1::3]
        first = float(np.cbrt(np.prod(values[0])))
        scales[track.node] = first if first > 1e-9 and abs(first - 1.0) >= 1e-4 else 1.0
        if np.ptp(values, axis=0).max() > 1e-3 * max(first, 1e-9):
            moving.append(track.node)
    if not moving:
        return scales, []
    return scales, [
        f"{len(moving)} joints, such as {tree.names[moving[0]]!r}, change their scale: "
        "that stays in the file, but lengths are those of the first frame."
    ]


def _rest(tree: Tree, joints: Joints) -> tuple[Array, Array]:
    """(J, 3) offsets, m, and (J, 4) turns at rest; joint 0 in the model frame."""
    nodes = list(joints.nodes)
    offsets = tree.moves[nodes] * joints.scales[:, None]
    turns = tree.turns[nodes].copy()
    offsets[0] = joints.move + rotate(joints.turn, offsets[0])
    turns[0] = mul(joints.turn, turns[0])
    return offsets, turns


def _skeleton(gltf: Gltf, tree: Tree, joints: Joints) -> Skeleton:
    offsets, turns = _rest(tree, joints)
    tips = {}
    for j, n in enumerate(joints.nodes):
        extras = gltf.item("nodes", n).get("extras")
        if isinstance(extras, dict) and TIP in extras:
            tip = gltf.numbers(extras, TIP, 3, f"extras of nodes[{n}]")
            assert tip is not None
            tips[j] = tip[OURS] * joints.scales[j]
    return Skeleton(
        names=joints.names,
        parents=joints.parents,
        offsets=offsets,
        rest_rotations=turns,
        tips=tips,
    )


def _unit(tree: Tree, joints: Joints, notes: list[str]) -> float:
    """Metres a unit: 1, unless the rest pose would be far too large then."""
    offsets, turns = _rest(tree, joints)
    skeleton = Skeleton(
        names=joints.names, parents=joints.parents, offsets=offsets, rest_rotations=turns
    )
    with np.errstate(all="ignore"):
        size = float(np.ptp(skeleton.rest_pose()[0], axis=0).max())
    if not LARGEST < size < np.inf:
        return 1.0
    unit, word = (0.01, "centimetres") if 0.01 * size <= LARGEST else (0.001, "millimetres")
    notes.append(f"Lengths in metres would make a skeleton of {size:.0f} m: {word} taken.")
    return unit


def _arrays(
    gltf: Gltf,
    skeleton: Skeleton,
    joints: Joints,
    tracks: dict[tuple[int, str], Track],
    grid: Grid,
    rest_turns: Array,
) -> tuple[Array, Array, Array | None]:
    """Root positions (T, 3), rotations (T, J, 4) and, where some change, translations (T, J, 3).

    Where one joint's translations change, those of all joints are as the file has them.
    """
    turns = np.tile(rest_turns, (grid.frames, 1, 1))
    places = np.tile(skeleton.offsets[0], (grid.frames, 1))
    size = float(np.abs(skeleton.offsets).sum(axis=1).max()) or 1.0
    held: dict[int, Array] = {}
    for (j, path), track in tracks.items():
        values = sample(track, key_values(gltf, track), grid)
        if path == "rotation":
            turns[:, j] = values[:, OURS_TURN]
            continue
        metres = values[:, OURS] * joints.scales[j]
        if j == 0:
            places = joints.move + rotate(joints.turn, metres)
        else:
            held[j] = metres
    turns[:, 0] = mul(joints.turn, turns[:, 0])
    if all(np.abs(v - skeleton.offsets[j]).max() <= STEADY * size for j, v in held.items()):
        return places, turns, None
    moves = np.tile(skeleton.offsets, (grid.frames, 1, 1))
    for j, metres in held.items():
        moves[:, j] = metres
    return places, turns, moves
