"""glTF: write clips into the file they came from, or into a new one.

Bytes of the file are only ever added to: meshes, skins, images, other animations and all channels
that did not change stay as they are. A changed channel gets a new accessor; frames of it that did
not change keep their numbers. An unchanged clip makes an identical file.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from footik_runtime.clip import Clip
from footik_runtime.errors import FootIKError
from footik_runtime.formats.gltf import GltfSource
from footik_runtime.formats.gltf_additions import Additions
from footik_runtime.formats.gltf_curves import with_curves
from footik_runtime.formats.gltf_new import new_gltf
from footik_runtime.formats.gltf_tracks import is_dense, key_values, sample
from footik_runtime.formats.gltf_tree import THEIRS, THEIRS_TURN, placed
from footik_runtime.quat_arrays import conj, mul, rotate, unit

Array = NDArray[np.float64]

SAME = 1e-9  # m, and of unit quaternions: less than float32 can tell


def write_gltf(clip: Clip | Sequence[Clip], path: str | os.PathLike[str]) -> None:
    """Write clips as .glb or .gltf, by the suffix.

    Args:
        clip: one clip, or several that were read from one file: each goes into its own animation
            there. A clip of another format makes a new file: nodes and one animation, no mesh.
        path: where to. What a .gltf names (buffers, images) is copied beside it.

    Raises:
        FootIKError: clips of several files, or a file that cannot be written.
    """
    clips = [clip] if isinstance(clip, Clip) else list(clip)
    target = Path(path)
    if target.suffix.lower() not in (".glb", ".gltf"):
        raise FootIKError(f"{path}: a glTF file ends in .glb or .gltf, not {target.suffix!r}.")
    sources = [source for one in clips if (source := _source(one)) is not None]
    if len(clips) == 1 and not sources:
        new_gltf(clips[0]).write(target)
        return
    if not clips or len(sources) < len(clips) or any(not _alike(s, sources[0]) for s in sources):
        raise FootIKError(
            f"{path}: several clips go into one file only where all were read from one glTF file."
        )
    additions = Additions(sources[0].gltf)
    for one, source in zip(clips, sources, strict=True):
        _put(additions, one, source)
    additions.write(target)


def _alike(a: GltfSource, b: GltfSource) -> bool:
    return a.gltf is b.gltf or a.gltf.raw == b.gltf.raw


def _source(clip: Clip) -> GltfSource | None:
    """Where a clip came from, if its joints are still those of the file."""
    source = clip.extras.get("gltf")
    if not isinstance(source, GltfSource) or clip.skeleton.names != source.joints.names:
        return None
    same = np.array_equal(clip.skeleton.parents, source.joints.parents)
    return source if same else None


def _put(additions: Additions, clip: Clip, source: GltfSource) -> None:
    """What of a clip differs from its source, into its animation."""
    aligned = len(clip) == source.grid.frames and clip.fps == source.grid.fps
    writer = _Writer(additions, clip, source, aligned)
    for j in range(len(clip.skeleton)):
        writer.rotation(j)
        writer.translation(j)
    extras = writer.changed_extras()
    if extras is not None:
        additions.animation(source.animation)["extras"] = extras


class _Writer:
    """One clip into one animation."""

    def __init__(self, additions: Additions, clip: Clip, source: GltfSource, aligned: bool) -> None:
        self.additions, self.clip, self.source, self.aligned = additions, clip, source, aligned
        self._times: int | None = None

    def rotation(self, j: int) -> None:
        source, turns = self.source, self.clip.rotations[:, j]
        local = mul(conj(source.joints.turn), turns) if j == 0 else turns
        if not self.aligned:
            rest = placed(source.gltf, source.joints.nodes[j])[1]
            if (j, "rotation") in source.tracks or _turned(local, rest).any():
                self._channel(j, "rotation", unit(local)[:, THEIRS_TURN], dense=False)
            return
        changed = _turned(turns, source.rotations[:, j])
        if not changed.any():
            return
        held = self._held(j, "rotation")
        given = unit(local)[:, THEIRS_TURN]
        given *= np.where(np.sum(given * held, axis=1, keepdims=True) < 0.0, -1.0, 1.0)
        self._channel(j, "rotation", np.where(changed[:, None], given, held), dense=True)

    def translation(self, j: int) -> None:
        source, joints = self.source, self.source.joints
        now = _places(self.clip, self.clip.root_positions, self.clip.translations, j)
        local = rotate(conj(joints.turn), now - joints.move) if j == 0 else now
        local = local[:, THEIRS] / joints.scales[j]
        if not self.aligned:
            rest = placed(source.gltf, joints.nodes[j])[0][THEIRS]
            moved = np.abs(local - rest).max() * joints.scales[j] > SAME
            if (j, "translation") in source.tracks or moved:
                self._channel(j, "translation", local, dense=False)
            return
        before = _places(self.clip, source.root_positions, source.translations, j)
        changed = np.abs(now - before).max(axis=1) > SAME
        if changed.any():
            held = self._held(j, "translation")
            self._channel(j, "translation", np.where(changed[:, None], local, held), dense=True)

    def _held(self, j: int, path: str) -> Array:
        """(T, width) values of the file, in its own axes, on the clip's frames."""
        source = self.source
        track = source.tracks.get((j, path))
        if track is not None:
            return sample(track, key_values(source.gltf, track), source.grid)
        move, turn, _ = placed(source.gltf, source.joints.nodes[j])
        rest = turn[THEIRS_TURN] if path == "rotation" else move[THEIRS]
        return np.tile(rest, (len(self.clip), 1))

    def _channel(self, j: int, path: str, values: Array, *, dense: bool) -> None:
        """Give a joint's channel new values; the key times stay where they are the frames."""
        additions, source = self.additions, self.source
        animation = additions.animation(source.animation)
        track = source.tracks.get((j, path))
        keeps = dense and track is not None and is_dense(track, source.grid)
        sampler = {
            "input": track.input if track is not None and keeps else self._frame_times(),
            "interpolation": "LINEAR",
            "output": additions.accessor(values),
        }
        samplers, channels = animation["samplers"], animation["channels"]
        if track is None:
            node = source.joints.nodes[j]
            additions.without_matrix(node)
            target = {"node": node, "path": path}
            channels.append({"sampler": len(samplers), "target": target})
            samplers.append(sampler)
        elif sum(channel.get("sampler") == track.sampler for channel in channels) == 1:
            extra = {k: v for k, v in samplers[track.sampler].items() if k not in sampler}
            samplers[track.sampler] = {**sampler, **extra}
        else:
            channels[track.channel]["sampler"] = len(samplers)
            samplers.append(sampler)

    def _frame_times(self) -> int:
        """The accessor of the clip's frames, s; one for all channels."""
        if self._times is None:
            times = self.source.grid.start + np.arange(len(self.clip)) / self.clip.fps
            self._times = self.additions.accessor(times[:, None])
        return self._times

    def changed_extras(self) -> dict[str, Any] | None:
        """The animation's extras with the clip's curves; None where they are as they were."""
        clip, source = self.clip, self.source
        curves = {name: np.asarray(v, dtype=np.float64) for name, v in clip.curves.items()}
        same = curves.keys() == source.curves.keys() and all(
            np.array_equal(v, source.curves[name]) for name, v in curves.items()
        )
        if same and clip.loop == source.loop:
            return None
        held = source.gltf.item("animations", source.animation).get("extras")
        extras = dict(held) if isinstance(held, dict) else {}
        if held is not None and not isinstance(held, dict):
            extras["extras"] = held
        return with_curves(extras, clip)


def _turned(a: Array, b: Array) -> NDArray[np.bool_]:
    """(T,) whether rotations differ; q and -q are one."""
    sign = np.where(np.sum(a * b, axis=-1, keepdims=True) < 0.0, -1.0, 1.0)
    return np.abs(a - sign * b).max(axis=-1) > SAME


def _places(clip: Clip, roots: Array, moves: Array | None, j: int) -> Array:
    """(T, 3) local translations of a joint, m; of the root, its place."""
    if j == 0:
        return roots
    return np.tile(clip.skeleton.offsets[j], (len(roots), 1)) if moves is None else moves[:, j]
