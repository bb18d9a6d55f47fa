"""MuJoCo trajectories: rows of qpos, or a column a joint, as clips of the model's bodies and back.

Read are archives (.npz) with an array "qpos", or with an array q_NAME for every joint and a root
given by tx, ty, tz, tilt, list and rotation; and tables (.csv) of qpos rows, with the quaternion in
either order. What a clip leaves alone is written as it was read; changed legs of hinges are solved
for the pose that the clip asks.
"""

from __future__ import annotations

import os
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from footik_runtime import quat_arrays as qa
from footik_runtime.clip import Clip
from footik_runtime.errors import FootIKError, listed
from footik_runtime.formats.euler import euler_to_quaternions, quaternions_to_euler
from footik_runtime.formats.qpos_rates import rate_of
from footik_runtime.formats.qpos_tables import (
    Table,
    read_table,
    time_column,
    with_arrays,
    write_table,
)
from footik_runtime.formats.qpos_tree import FREE, WIDTHS, Tree, locals_of, tree_of
from footik_runtime.formats.qpos_write import qpos_of, qvel_of
from footik_runtime.rig import Rig

Array = NDArray[np.float64]

SOURCE = "qpos"
"""The entry of a clip's extras that holds the `QposSource` it came from."""

LARGEST_VALUE = 1e15
"""m or rad: whatever is beyond was never measured, and its square may overflow."""

_ROOT_PLACE = ("tx", "ty", "tz")
_ROOT_TURN = {"list": 0, "tilt": 1, "rotation": 2}  # part of a root -> axis


@dataclass(frozen=True, kw_only=True, eq=False)
class Posed:
    """Joint values that were solved for a clip, and the clip they make.

    root_positions: (T, 3) m. rotations: (T, J, 4). qpos: (T, nq). report: of `qpos_write.qpos_of`.
    """

    root_positions: Array
    rotations: Array
    qpos: Array
    report: dict[str, Any]


@dataclass(frozen=True, kw_only=True, eq=False)
class QposSource:
    """Where a clip of joint values came from.

    Attributes:
        table: the file.
        tree: the model's bodies; its `rig` has legs with measured soles.
        qpos: (T, nq) as read; joints the file does not have are at the model's qpos0.
        columns: name of an array of the table -> its column of qpos; one joint a column.
        rows: name of the array (T, nq) of the table, or None.
        quaternion_last: the root's quaternion is x, y, z, w in the table.
        root: prefix of the root's six columns, or None; turn: its rotations, outermost first.
        clip: the clip as it was read.
        notes: what was guessed or left out, a line each.
        posed: the joint values of a changed clip, where they were solved already.
    """

    table: Table
    tree: Tree
    qpos: Array
    columns: dict[str, int] = field(default_factory=dict)
    rows: str | None = None
    quaternion_last: bool = False
    root: str | None = None
    turn: tuple[str, ...] = ()
    clip: Clip | None = None
    notes: tuple[str, ...] = ()
    posed: Posed | None = None


def read_qpos(
    path: str | os.PathLike[str],
    model: mujoco.MjModel | str | os.PathLike[str],
    *,
    fps: float | None = None,
) -> Clip:
    """Read joint values of a model as a clip of its bodies.

    Args:
        path: an .npz or .csv file.
        model: compiled, or the path of its XML.
        fps: frames a second; by default what the file says, or what its velocities tell.

    Raises:
        FootIKError: a broken file, one of another model, or one that does not tell its rate.
    """
    tree = tree_of(model if isinstance(model, mujoco.MjModel) else read_model(model))
    table = read_table(path)
    source = _by_rows(table, tree, path) or _by_columns(table, tree, path)
    if len(source.qpos) == 0:
        raise FootIKError(f"{path}: has no frames.")
    bad = np.argwhere(~(np.abs(source.qpos) <= LARGEST_VALUE))  # so written, NaN is bad too
    if len(bad):
        raise FootIKError(
            f"{path}: the joint values are not finite at frame {bad[0][0]}, or beyond "
            f"{LARGEST_VALUE:g}."
        )
    rate, note = (fps, ()) if fps is not None else rate_of(table, source.columns, path)
    roots, rotations, moves = locals_of(tree, source.qpos)
    clip = Clip(
        skeleton=tree.skeleton,
        fps=rate,
        root_positions=roots,
        rotations=rotations,
        translations=moves,
        name=Path(path).stem,
    )
    source = replace(source, clip=clip, notes=source.notes + note)
    return clip.with_extras(**{SOURCE: source})


def rig_of(clip: Clip) -> Rig | None:
    """The rig of the model a clip's joint values are for, soles measured from its geoms."""
    source = clip.extras.get(SOURCE)
    return source.tree.rig if isinstance(source, QposSource) else None


def read_model(path: str | os.PathLike[str]) -> mujoco.MjModel:
    """The model of an MJCF file. Raises FootIKError where MuJoCo cannot read it."""
    if not os.path.isfile(path):  # MuJoCo would write a log of its own
        raise FootIKError(f"{path}: there is no such model file.")
    try:
        return mujoco.MjModel.from_xml_path(os.fspath(path))
    except (ValueError, OSError, UnicodeError) as error:
        reason = " ".join(str(error).split())
        raise FootIKError(f"{path}: not a model that MuJoCo reads: {reason}") from None


# --- layouts ------------------------------------------------------------------------------------


def _by_rows(table: Table, tree: Tree, path: str | os.PathLike[str]) -> QposSource | None:
    if not table.is_csv:
        rows = table.arrays.get("qpos")
        if rows is None:
            return None
        if rows.ndim != 2 or rows.shape[1] != tree.width or rows.dtype.kind not in "fiu":
            raise FootIKError(
                f"{path}: qpos is {rows.shape} of {rows.dtype}; this model's rows have "
                f"{tree.width} numbers."
            )
        return QposSource(table=table, tree=tree, qpos=rows.astype(np.float64), rows="qpos")
    if table.header is not None and any(name.startswith("q_") for name in table.header):
        return None
    skipped = time_column(table)
    names = [name for name in table.arrays if name != skipped]
    if len(names) != tree.width:
        raise FootIKError(
            f"{path}: has {len(names)} columns of joint values; this model's rows have "
            f"{tree.width} numbers."
        )
    qpos = np.stack([table.arrays[name] for name in names], axis=-1)
    last = _quaternion_last(tree, qpos)
    notes = ("the root's quaternion is taken as x, y, z, w: so the body stands",) if last else ()
    if last:
        qpos[:, 3:7] = np.roll(qpos[:, 3:7], 1, axis=-1)
    columns = {name: i for i, name in enumerate(names)}
    return QposSource(
        table=table, tree=tree, qpos=qpos, columns=columns, quaternion_last=last, notes=notes
    )


def _quaternion_last(tree: Tree, qpos: Array) -> bool:
    """Whether the root stands more upright with its quaternion read as x, y, z, w.

    Both orders have length 1. Where both stand, the body either faces ahead in this order or
    back in the other: ahead it is.
    """
    if not tree.joints[0] or tree.joints[0][0].kind != FREE or tree.joints[0][0].column != 0:
        return False
    up = np.array([0.0, 0.0, 1.0])
    if not (np.abs(qpos[:, 3:7]) <= LARGEST_VALUE).all():
        return False  # refused later, with its place
    first = qa.unit(qpos[:, 3:7])
    last = np.roll(first, 1, axis=-1)
    standing = [qa.rotate(turns, up)[:, 2].mean() for turns in (first, last)]
    return bool(standing[1] > standing[0] - 0.02)


def _by_columns(table: Table, tree: Tree, path: str | os.PathLike[str]) -> QposSource:
    given = {
        name[2:]: name
        for name, array in table.arrays.items()
        if name.startswith("q_") and array.ndim == 1 and array.dtype.kind in "fiu"
    }
    joints = {n: j for n, j in tree.named().items() if WIDTHS[j.kind] == 1}
    found = {name: joints[name] for name in given if name in joints}
    root, turn = _root_columns(given, tree)
    if not found:
        raise FootIKError(
            f"{path}: has neither an array 'qpos' nor a q_NAME of this model's joints "
            f"({listed(joints)}); it has {listed(table.arrays)}."
        )
    lengths = {len(table.arrays[given[name]]) for name in found}
    if root is not None:
        lengths |= {len(table.arrays[given[f"{root}_{part}"]]) for part in (*_ROOT_PLACE, *turn)}
    if len(lengths) != 1:
        raise FootIKError(f"{path}: its joints have different lengths: {sorted(lengths)}.")
    frames = lengths.pop()
    qpos = np.tile(tree.rest, (frames, 1))
    for name, joint in found.items():
        qpos[:, joint.column] = table.arrays[given[name]]
    notes = [
        f"{what}: {listed(sorted(names))}"
        for what, names in (
            ("not of this model", set(given) - set(found) - _root_names(root)),
            ("not in the file, left as in the model", set(joints) - set(found)),
        )
        if names
    ]
    if root is not None:
        start = tree.joints[0][0].column
        place = np.stack([table.arrays[given[f"{root}_{p}"]] for p in _ROOT_PLACE], axis=-1)
        angles = np.stack([table.arrays[given[f"{root}_{p}"]] for p in turn])
        qpos[:, start : start + 3] = tree.skeleton.offsets[0] + place
        order = tuple(_ROOT_TURN[p] for p in turn)
        qpos[:, start + 3 : start + 7] = euler_to_quaternions(angles.astype(float), order).T
        notes.append("the root's place is taken from the model's own: heights may be off")
    return QposSource(
        table=table,
        tree=tree,
        qpos=qpos,
        columns={given[name]: joint.column for name, joint in found.items()},
        root=root,
        turn=turn,
        notes=tuple(notes),
    )


def _root_columns(given: dict[str, str], tree: Tree) -> tuple[str | None, tuple[str, ...]]:
    """Prefix of the six columns of a free root, and its rotations in the order of the file."""
    if not tree.joints[0] or tree.joints[0][0].kind != FREE:
        return None, ()
    for name in given:
        prefix = name.removesuffix("_tx")
        if prefix != name and _root_names(prefix) <= set(given):
            parts = [n.removeprefix(f"{prefix}_") for n in given if n in _root_names(prefix)]
            return prefix, tuple(part for part in parts if part in _ROOT_TURN)
    return None, ()


def _root_names(prefix: str | None) -> set[str]:
    if prefix is None:
        return set()
    return {f"{prefix}_{part}" for part in (*_ROOT_PLACE, *_ROOT_TURN)}


# --- writing ------------------------------------------------------------------------------------


def write_qpos(clip: Clip, path: str | os.PathLike[str]) -> dict[str, Any]:
    """Write a clip that came from joint values in the layout it came in.

    Values of joints that the clip left alone stay exactly; velocities that the file has are
    brought along. Returns what could not be reached: see `qpos_write.qpos_of`.

    Raises:
        FootIKError: a clip from elsewhere or of other frames, or a file that cannot be written.
    """
    source = clip.extras.get(SOURCE)
    if not isinstance(source, QposSource) or source.clip is None:
        raise FootIKError(
            f"{clip.name}: only clips that were read from joint values are written as such."
        )
    posed = source.posed
    if posed is not None and _is(clip, posed):
        qpos, report = posed.qpos, posed.report
    else:
        qpos, report = qpos_of(clip, source.clip, source.tree, source.qpos)
    write_table(path, with_arrays(source.table, _changed_arrays(source, qpos, clip.fps)))
    return report


def _is(clip: Clip, posed: Posed) -> bool:
    return np.array_equal(clip.root_positions, posed.root_positions) and np.array_equal(
        clip.rotations, posed.rotations
    )


def _changed_arrays(source: QposSource, qpos: Array, fps: float) -> dict[str, NDArray[Any]]:
    arrays = source.table.arrays
    if source.rows is not None:
        # Where nothing changed this is what was read: float64 holds every float32.
        changed, speeds = {source.rows: qpos}, arrays.get("qvel")
        if (
            speeds is not None
            and speeds.dtype.kind in "fiu"
            and speeds.shape == (len(qpos), source.tree.speeds)
        ):
            changed["qvel"] = qvel_of(source.tree, speeds, qpos - source.qpos, fps)
        return changed
    out = qpos
    if source.quaternion_last:
        out = qpos.copy()
        out[:, 3:7] = np.roll(qpos[:, 3:7], -1, axis=-1)
    values = {name: out[:, column] for name, column in source.columns.items()}
    if source.root is not None:
        values |= _root_values(source, qpos)
    changed = {}
    for name, value in values.items():
        before = arrays[name].astype(np.float64)
        change = value - before
        if not change.any():
            continue
        changed[name] = value
        velocity = arrays.get(f"d{name}")
        if velocity is None or velocity.dtype.kind not in "fiu":
            continue
        if velocity.shape == value.shape and len(value) > 1:
            changed[f"d{name}"] = velocity + np.gradient(change) * fps
    return changed


def _root_values(source: QposSource, qpos: Array) -> dict[str, Array]:
    """The root's six columns; those of unchanged frames as they were."""
    start = source.tree.joints[0][0].column
    arrays = source.table.arrays
    same = qpos == source.qpos
    out = {}
    for i, part in enumerate(_ROOT_PLACE):
        name = f"q_{source.root}_{part}"
        place = qpos[:, start + i] - source.tree.skeleton.offsets[0, i]
        out[name] = np.where(same[:, start + i], arrays[name], place)
    names = [f"q_{source.root}_{part}" for part in source.turn]
    known = np.stack([arrays[name].astype(np.float64) for name in names], axis=-1)[:, None]
    order = tuple(_ROOT_TURN[part] for part in source.turn)
    turns = qpos[:, None, start + 3 : start + 7]
    kept = same[:, start + 3 : start + 7].all(axis=-1)[:, None]
    angles = quaternions_to_euler(turns, order, kept, known)[:, 0]
    return out | {name: angles[:, i] for i, name in enumerate(names)}
