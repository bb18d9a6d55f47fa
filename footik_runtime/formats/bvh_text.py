"""The text of a BVH file: its joints, channels and numbers, in the file's own axes and units.

Whatever is wrong with a file is a FootIKError that names the file and the line.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from pathlib import Path
from typing import NoReturn

import numpy as np
from numpy.typing import NDArray

from footik_runtime.errors import FootIKError, unknown_name
from footik_runtime.formats.number_text import NUMERIC, read_numbers

Array = NDArray[np.float64]

CHANNELS = tuple(f"{axis}{kind}" for kind in ("position", "rotation") for axis in "XYZ")
_BY_FOLDED = {name.lower(): name for name in CHANNELS}

# Possessive quantifiers (++) keep every search linear, whatever the file holds.
_TOKEN = re.compile(rb"[{}]|[^\s{}]++")
_COUNT = re.compile(rb"\s*+Frames\s*+:?+\s*+(\S*+)", re.IGNORECASE)
_TIME = re.compile(rb"\s*+Frame\s*+Time\s*+:?+\s*+(\S*+)", re.IGNORECASE)


@dataclass(frozen=True, kw_only=True, eq=False)
class BvhText:
    """One parsed file, untouched: numbers as read, and the text they were read from.

    Attributes:
        names: of the J joints, parents before children.
        parents: (J,) indices, -1 for the root.
        channels: of each joint, in the file's order, spelled as in CHANNELS.
        offsets: the three numbers' text, of each joint.
        tips: joint index -> the text of its end site's offset.
        frame_time: text, seconds.
        motion: the text of all frames.
        values: (T, C) one row a frame.
        notes: what was odd but readable, a sentence each.
    """

    names: tuple[str, ...]
    parents: tuple[int, ...]
    channels: tuple[tuple[str, ...], ...]
    offsets: tuple[str, ...]
    tips: dict[int, str]
    frame_time: str
    motion: bytes = field(repr=False)
    values: Array = field(repr=False)
    notes: tuple[str, ...]


def numbers(text: str) -> Array:
    """The numbers of an offset's text."""
    return np.array([float(word) for word in text.split()])


def parse_bvh(path: Path) -> BvhText:
    """Read and check one file. Raises FootIKError on anything that is not a whole BVH file."""
    source = _Source(path)
    hierarchy = _Hierarchy(source)
    hierarchy.read()
    width = sum(map(len, hierarchy.channels))
    if not width:
        source.fail("no joint has channels, so the file holds no motion")
    count = source.header(_COUNT, "Frames:")
    if not re.fullmatch(r"[+-]?\d+", count):
        source.fail(f"'Frames:' must be followed by a whole number, not {_shown(count)}")
    time = source.header(_TIME, "Frame Time:")
    if not (NUMERIC.fullmatch(time.encode()) and 0.0 < float(time) < float("inf")):
        source.fail(f"the frame time must be a positive number of seconds, not {_shown(time)}")
    values, notes = _Motion(source, hierarchy.names, hierarchy.channels, width).read()
    if count.lstrip("+0") != str(len(values)):
        told = count if len(count) < 20 else f"{count[:20]}…"
        notes.append(f"The header tells of {told} frames; the file holds {len(values)}.")
    return BvhText(
        names=tuple(hierarchy.names),
        parents=tuple(hierarchy.parents),
        channels=tuple(hierarchy.channels),
        offsets=tuple(hierarchy.offsets),
        tips=hierarchy.tips,
        frame_time=time,
        motion=source.data[source.at :],
        values=values,
        notes=tuple(hierarchy.notes + notes),
    )


def _shown(text: str, limit: int = 30) -> str:
    """A piece of the file as a message may quote it."""
    if not text:
        return "the end of the file"
    return repr(text if len(text) <= limit else text[:limit] + "…")


def _decoded(piece: bytes) -> str:
    try:
        return piece.decode("utf-8")
    except UnicodeDecodeError:
        return piece.decode("latin-1")


class _Source:
    """The bytes of a file and the place reached in them."""

    def __init__(self, path: Path) -> None:
        self.name = path.name or str(path)
        try:
            data = path.read_bytes()
        except FileNotFoundError:
            raise FootIKError(f"{path}: there is no such file.") from None
        except IsADirectoryError:
            raise FootIKError(f"{path}: this is a directory, not a BVH file.") from None
        except (OSError, ValueError) as error:
            reason = getattr(error, "strerror", None) or error
            raise FootIKError(f"{path}: the file cannot be read: {reason}.") from None
        data = data.removeprefix(b"\xef\xbb\xbf")
        self.data = data if b"\n" in data else data.replace(b"\r", b"\n")
        self.at = 0
        if not data.strip():
            self.fail("the file is empty; a BVH file begins with HIERARCHY")
        if b"\0" in data:
            self.fail("this is a binary file, not BVH text", data.index(b"\0"))

    def fail(self, what: str, at: int | None = None) -> NoReturn:
        line = self.data.count(b"\n", 0, self.at if at is None else at) + 1
        raise FootIKError(f"{self.name}, line {line}: {what}.")

    def token(self) -> str:
        """The next word or brace; empty at the end of the file."""
        match = _TOKEN.search(self.data, self.at)
        if match is None:
            self.at = len(self.data)
            return ""
        self.at = match.end()
        return _decoded(match.group())

    def rest_of_line(self) -> str:
        """What stands before the end of the line, or before a brace."""
        match = re.compile(rb"[^\n{}]*+").match(self.data, self.at)
        assert match is not None
        self.at = match.end()
        return " ".join(_decoded(match.group()).split())

    def header(self, pattern: re.Pattern[bytes], what: str) -> str:
        match = pattern.match(self.data, self.at)
        if match is None:
            word = self.token()
            self.fail(f"expected {what!r}, not {_shown(word)}")
        self.at = match.end()
        return _decoded(match.group(1))


class _Hierarchy:
    """Reads the joints, without recursion: a file may nest as deep as it likes."""

    def __init__(self, source: _Source) -> None:
        self.source = source
        self.names: list[str] = []
        self.parents: list[int] = []
        self.channels: list[tuple[str, ...]] = []
        self.offsets: list[str] = []
        self.tips: dict[int, str] = {}
        self.notes: list[str] = []
        self._open: list[int] = []
        self._seen: set[str] = set()

    def read(self) -> None:
        source = self.source
        if (word := source.token()).upper() != "HIERARCHY":
            source.fail(f"a BVH file begins with HIERARCHY, not {_shown(word)}")
        while (word := source.token()).upper() != "MOTION" or self._open:
            self._statement(word)
        if not self.names:
            source.fail("the hierarchy has no ROOT")

    def _statement(self, word: str) -> None:
        source, keyword = self.source, word.upper()
        if keyword == "ROOT" and self.names:
            source.fail(
                f"a second ROOT; a file holds one skeleton, and {self.names[0]!r} is its root"
            )
        elif keyword == "ROOT" or (keyword == "JOINT" and self._open):
            self._joint(keyword)
        elif not self._open:
            wanted = "MOTION" if self.names else "ROOT"
            source.fail(f"expected {wanted}, not {_shown(word)}")
        elif keyword == "OFFSET":
            self._give(self.offsets, self._offset(), "OFFSET")
        elif keyword == "CHANNELS":
            self._give(self.channels, self._channels(), "CHANNELS")
        elif keyword == "END":
            self._end_site()
        elif word == "}":
            self._close()
        else:
            source.fail(
                f"expected OFFSET, CHANNELS, JOINT, End Site or '}}' in joint "
                f"{self.names[self._open[-1]]!r}, not {_shown(word)}"
            )

    def _joint(self, keyword: str) -> None:
        source = self.source
        name = source.rest_of_line()
        if not name:
            source.fail(f"a {keyword} needs a name")
        if name in self._seen:
            source.fail(f"a second joint named {_shown(name)}; joint names must be unique")
        self._brace(f"{keyword} {name}")
        self._seen.add(name)
        self.parents.append(self._open[-1] if self._open else -1)
        self._open.append(len(self.names))
        self.names.append(name)
        self.offsets.append("")
        self.channels.append(("",))  # until its line is read

    def _brace(self, what: str) -> None:
        if (word := self.source.token()) != "{":
            self.source.fail(f"expected '{{' after {_shown(what)}, not {_shown(word)}")

    def _give(self, where: list, value, what: str) -> None:
        joint = self._open[-1]
        if where[joint] not in ("", ("",)):
            self.source.fail(f"a second {what} in joint {self.names[joint]!r}")
        where[joint] = value

    def _offset(self) -> str:
        words = []
        for _ in range(3):
            word = self.source.token()
            if not NUMERIC.fullmatch(word.encode()) or not np.isfinite(float(word)):
                joint = self.names[self._open[-1]]
                self.source.fail(
                    f"OFFSET of joint {joint!r} needs three finite numbers, not {_shown(word)}"
                )
            words.append(word)
        return " ".join(words)

    def _channels(self) -> tuple[str, ...]:
        source, joint = self.source, self.names[self._open[-1]]
        count = source.token()
        if not re.fullmatch(r"[0-6]", count):
            source.fail(f"CHANNELS of joint {joint!r} needs a count of 0 to 6, not {_shown(count)}")
        listed: list[str] = []
        for _ in range(int(count)):
            word = source.token()
            if word.lower() not in _BY_FOLDED:
                error = unknown_name("channel", word[:30] or "end of file", CHANNELS)
                source.fail(f"joint {joint!r} has an {str(error).rstrip('.')}")
            listed.append(_BY_FOLDED[word.lower()])
        places = [name for name in listed if name.endswith("position")]
        if len(set(places)) < len(places) or len(listed) - len(places) > 3:
            source.fail(
                f"CHANNELS of joint {joint!r} may name each position once and three rotations at "
                f"most, not {' '.join(listed)}"
            )
        return tuple(listed)

    def _end_site(self) -> None:
        source, joint = self.source, self._open[-1]
        source.rest_of_line()
        self._brace("End Site")
        if (word := source.token()).upper() != "OFFSET":
            source.fail(
                f"expected OFFSET in the End Site of {self.names[joint]!r}, not {_shown(word)}"
            )
        if joint in self.tips:
            self._offset()
            self.notes.append(
                f"Joint {self.names[joint]!r} has several end sites; the first counts."
            )
        else:
            self.tips[joint] = self._offset()
        if (word := source.token()) != "}":
            source.fail(
                f"expected '}}' after the End Site of {self.names[joint]!r}, not {_shown(word)}"
            )

    def _close(self) -> None:
        joint = self._open.pop()
        if not self.offsets[joint]:
            self.source.fail(f"joint {self.names[joint]!r} has no OFFSET")
        if self.channels[joint] == ("",):
            self.channels[joint] = ()


class _Motion:
    """Reads the frames: all numbers at once, then the checks that say where one is wrong."""

    def __init__(
        self, source: _Source, names: list[str], channels: list[tuple[str, ...]], width: int
    ) -> None:
        self.source, self.names, self.channels, self.width = source, names, channels, width
        self.text = source.data[source.at :]

    def read(self) -> tuple[Array, list[str]]:
        """Values (T, C) of the whole frames, and notes."""
        found, begins = read_numbers(self.text)
        if len(found) < len(begins):
            at = int(begins[len(found)])
            word = _TOKEN.search(self.text, at)
            shown = _shown(_decoded(word.group())) if word else "the end of the file"
            self.source.fail(f"{shown} in the motion is not a number", self.source.at + at)
        notes = self._line_notes(begins)
        frames = len(found) // self.width
        if frames == 0:
            self.source.fail(
                f"the file ends before its first whole frame: {len(found)} of the "
                f"{self.width} values a frame needs",
                len(self.source.data),
            )
        values = found[: frames * self.width].reshape(frames, self.width)
        if not np.isfinite(values).all():
            self._fail_not_finite(values, begins)
        return values, notes

    def _line_notes(self, begins: NDArray[np.int64]) -> list[str]:
        """Check that lines are frames, where they are; a cut last frame is only a note."""
        breaks = np.flatnonzero(np.frombuffer(self.text, dtype=np.uint8) == ord("\n"))
        ends = np.append(np.searchsorted(begins, breaks), len(begins))
        counts = np.diff(ends, prepend=0)
        lines = np.flatnonzero(counts)
        wrong = lines[counts[lines] != self.width]
        # A file none of whose lines is a frame has wrapped them: only the total counts then.
        if 0 < len(wrong) < len(lines):
            held = counts[wrong[0]]
            if wrong[0] != lines[-1] or held > self.width:
                self.source.fail(
                    f"the line holds {held} values; a frame of this hierarchy has {self.width}",
                    self.source.at + int(begins[ends[wrong[0]] - 1]),
                )
        rest = len(begins) % self.width
        return [f"The last frame is cut after {rest} of {self.width} values."] if rest else []

    def _fail_not_finite(self, values: Array, begins: NDArray[np.int64]) -> NoReturn:
        frame, column = (int(n) for n in np.argwhere(~np.isfinite(values))[0])
        owners = [(j, name) for j, names in enumerate(self.channels) for name in names]
        joint, channel = owners[column]
        at = int(begins[frame * self.width + column])
        bad = np.count_nonzero(~np.isfinite(values).all(axis=1))
        self.source.fail(
            f"frame {frame}, joint {self.names[joint]!r}, channel {channel} is "
            f"{values[frame, column]}; every value must be finite ({bad} of {len(values)} frames "
            "are bad)",
            self.source.at + at,
        )
