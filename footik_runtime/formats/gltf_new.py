"""A new glTF file for a clip of another format: its joints as nodes, one animation, no mesh."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from footik_runtime.clip import Clip
from footik_runtime.formats.glb_container import Gltf
from footik_runtime.formats.gltf_additions import Additions
from footik_runtime.formats.gltf_curves import TIP, with_curves
from footik_runtime.formats.gltf_tree import THEIRS, THEIRS_TURN

Array = NDArray[np.float64]

_STILL = np.array([1.0, 0.0, 0.0, 0.0])


def new_gltf(clip: Clip) -> Additions:
    """A document that holds a clip, to be written; every channel has one key a frame."""
    skeleton = clip.skeleton
    nodes = [_node(clip, j) for j in range(len(skeleton))]
    document = {
        "asset": {"version": "2.0", "generator": "footik-runtime"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": nodes,
        "animations": [{"name": clip.name, "channels": [], "samplers": []}],
    }
    additions = Additions(Gltf(path=Path(clip.name), json=document, raw=b"", is_glb=False))
    animation = additions.animation(0)
    times = additions.accessor(np.arange(len(clip))[:, None] / clip.fps)

    def add(j: int, path: str, values: Array) -> None:
        sampler = len(animation["samplers"])
        output = additions.accessor(values)
        animation["samplers"].append({"input": times, "interpolation": "LINEAR", "output": output})
        animation["channels"].append({"sampler": sampler, "target": {"node": j, "path": path}})

    add(0, "translation", clip.root_positions[:, THEIRS])
    for j in range(len(skeleton)):
        # One for each joint, moving or not: by that they are known as joints.
        add(j, "rotation", clip.rotations[:, j][:, THEIRS_TURN])
        moves = None if clip.translations is None or j == 0 else clip.translations[:, j]
        if moves is not None and (moves != skeleton.offsets[j]).any():
            add(j, "translation", moves[:, THEIRS])
    extras = with_curves({}, clip)
    if extras:
        animation["extras"] = extras
    return additions


def _node(clip: Clip, j: int) -> dict[str, Any]:
    skeleton = clip.skeleton
    node: dict[str, Any] = {"name": skeleton.names[j]}
    children = skeleton.children(j)
    if children:
        node["children"] = children
    node["translation"] = skeleton.offsets[j][THEIRS].tolist()
    if (skeleton.rest_rotations[j] != _STILL).any():
        node["rotation"] = skeleton.rest_rotations[j][THEIRS_TURN].tolist()
    if j in skeleton.tips:
        node["extras"] = {TIP: np.asarray(skeleton.tips[j])[THEIRS].tolist()}
    return node
