"""Small glTF files for tests, built piece by piece."""

from __future__ import annotations

import base64
import json
from pathlib import Path
from typing import Any

import numpy as np

from footik_runtime.formats.glb_container import BIN_CHUNK, pack_glb

KINDS = {1: "SCALAR", 3: "VEC3", 4: "VEC4", 16: "MAT4"}
CODES = {"f4": 5126, "i1": 5120, "u1": 5121, "i2": 5122, "u2": 5123, "u4": 5125}


class Document:
    """A glTF document under construction."""

    def __init__(self, nodes: list[dict[str, Any]], joints: list[int] | None = None) -> None:
        self.data = b""
        self.json: dict[str, Any] = {
            "asset": {"version": "2.0"},
            "nodes": nodes,
            "accessors": [],
            "bufferViews": [],
            "animations": [],
        }
        if joints is not None:
            self.json["skins"] = [{"joints": joints}]

    def view(self, data: bytes, **more: Any) -> int:
        self.data += bytes(-len(self.data) % 4)
        place = {"buffer": 0, "byteOffset": len(self.data), "byteLength": len(data)}
        self.json["bufferViews"].append({**place, **more})
        self.data += data
        return len(self.json["bufferViews"]) - 1

    def accessor(self, values: Any, kind: str = "f4", **more: Any) -> int:
        array = np.asarray(values, dtype=f"<{kind}")
        array = array[:, None] if array.ndim == 1 else array
        owner = {
            "bufferView": self.view(array.tobytes()),
            "componentType": CODES[kind],
            "count": len(array),
            "type": KINDS[array.shape[1]],
            **more,
        }
        if array.shape[1] == 1 and len(array):
            owner |= {"min": [float(array.min())], "max": [float(array.max())]}
        self.json["accessors"].append(owner)
        return len(self.json["accessors"]) - 1

    def animate(self, *channels: tuple[int, str, Any, Any], kind: str = "LINEAR", **more: Any):
        """Add an animation; channels are (node, path, times, values)."""
        samplers = [
            {"input": self.accessor(t), "output": self.accessor(v), "interpolation": kind}
            for _, _, t, v in channels
        ]
        targets = [{"node": node, "path": path} for node, path, _, _ in channels]
        self.json["animations"].append(
            {
                "channels": [{"sampler": s, "target": t} for s, t in enumerate(targets)],
                "samplers": samplers,
                **more,
            }
        )
        return self

    def glb(self, path: Path) -> Path:
        document = {**self.json, "buffers": [{"byteLength": len(self.data)}]}
        path.write_bytes(pack_glb(document, [(BIN_CHUNK, self.data)]))
        return path

    def gltf(self, path: Path, *, embedded: bool = False) -> Path:
        uri = f"{path.stem}.bin"
        if embedded:
            uri = "data:application/octet-stream;base64," + base64.b64encode(self.data).decode()
        else:
            path.with_name(uri).write_bytes(self.data)
        document = {**self.json, "buffers": [{"byteLength": len(self.data), "uri": uri}]}
        path.write_text(json.dumps(document))
        return path


def walker(frames: int = 5, fps: float = 30.0) -> Document:
    """Root, hip, knee and ankle of one leg; the root goes along +z, the hip turns about x."""
    nodes = [
        {"name": "root", "children": [1]},
        {"name": "hip", "children": [2], "translation": [0.1, 0.9, 0.0]},
        {"name": "knee", "children": [3], "translation": [0.0, -0.45, 0.0]},
        {"name": "ankle", "translation": [0.0, -0.4, 0.05]},
    ]
    times = np.arange(frames) / fps
    along = np.stack([0 * times, 0 * times, times], axis=1)
    half = 0.2 * np.sin(7.0 * times)
    turns = np.stack([np.sin(half), 0 * half, 0 * half, np.cos(half)], axis=1)
    return Document(nodes, [0, 1, 2, 3]).animate(
        (0, "translation", times, along), (1, "rotation", times, turns), name="walk"
    )
