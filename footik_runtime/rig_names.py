"""What joint names say: side, front or hind, and which part of a leg, in the known conventions.

A word alone does not settle a part: `LeftLeg` is the shin in one convention and the thigh in
another, `L_Foot` the toes in SMPL. So each word gives weights to the parts it may mean, and the
best chain hip -> knee -> ankle (-> toe) of ancestors wins as a whole.
"""

from __future__ import annotations

import difflib
import re
from collections.abc import Sequence
from itertools import combinations
from typing import NamedTuple

Chain = tuple[int, int, int, int]  # hip, knee, ankle, toe (-1 where there is none)
# Left before right, front before hind.
LEG_NAMES = ("left", "right", "left_front", "right_front", "left_hind", "right_hind")

_HIP, _KNEE, _ANKLE, _TOE = range(4)

# Word -> weight as (hip, knee, ankle, toe) joint. The larger, the surer.
_LEG_WORDS: dict[str, tuple[float, float, float, float]] = {
    **dict.fromkeys(("thigh", "femur", "upleg", "upperleg", "legupper", "legup"), (4, 0, 0, 0)),
    "hip": (2, 0, 0, 0),
    "hips": (2, 0, 0, 0),
    "hipjoint": (1, 0, 0, 0),  # carries the thigh in CMU, is the thigh elsewhere
    "leg": (1, 3, 0, 0),
    **dict.fromkeys(("shin", "calf", "tibia", "shank", "knee", "lowerleg"), (0, 4, 0, 0)),
    **dict.fromkeys(("lowleg", "leglower", "leglow", "crus"), (0, 4, 0, 0)),
    "ankle": (0, 0, 4, 0),
    "foot": (0, 0, 3, 1),
    "paw": (0, 0, 2, 2),
    "hoof": (0, 0, 2, 2),
    **dict.fromkeys(("toe", "toes", "toebase", "ball", "forefoot"), (0, 0, 0, 4)),
    **dict.fromkeys(("footthumb", "footindex", "bigtoe"), (0, 0, 0, 3)),
}
SHIN_WORDS = frozenset(word for word, weights in _LEG_WORDS.items() if weights[_KNEE] >= 4)
_NUMBERED_LEG = (1.0, 3.0, 0.5, 0.25)  # leg_joint_1, 2, 3, 5: all parts are called "leg"
# The same for the front legs of animals that are rigged with arms.
_ARM_WORDS: dict[str, tuple[float, float, float, float]] = {
    **dict.fromkeys(("upperarm", "humerus", "arm", "uparm"), (4, 0, 0, 0)),
    **dict.fromkeys(("forearm", "lowerarm", "radius", "elbow", "lowarm"), (0, 4, 0, 0)),
    **dict.fromkeys(("hand", "wrist", "paw"), (0, 0, 4, 1)),
    **dict.fromkeys(("finger", "fingers"), (0, 0, 0, 2)),
}
_HIPS_WORDS = frozenset(("hips", "hip", "pelvis"))
_SIDES = {"l": "left", "left": "left", "r": "right", "right": "right"}
_ENDS = dict.fromkeys(("front", "fore"), "front") | dict.fromkeys(("back", "rear", "hind"), "hind")
_CORNERS = {
    **dict.fromkeys(("fl", "lf"), ("left", "front")),
    **dict.fromkeys(("fr", "rf"), ("right", "front")),
    **dict.fromkeys(("rl", "lr", "hl", "lh", "bl", "lb"), ("left", "hind")),
    **dict.fromkeys(("rr", "hr", "rh", "br", "rb"), ("right", "hind")),
}
# Joints with these words steer or decorate others; no leg runs through them.
_HELPERS = frozenset(
    re.split(
        r"\s+",
        "ik control ctrl pole target twist helper nub end effector eff socket slot mesh geo mch "
        "org aim tweak pivot heel",
    )
)
# Words that say nothing about the part.
_NOISE = frozenset(
    re.split(
        r"\s+",
        "b j m f avg bip def bone bn jnt joint link body rig mixamorig character skeleton skel sk "
        "cc base smpl skin pitch yaw roll x y z rx ry rz",
    )
)
_FORE = re.compile(r"fore[ _-]?(arm|foot)", re.IGNORECASE)  # a part, not the front end
_TOKEN = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+|\d+")


class Label(NamedTuple):
    """What one joint name says; empty strings where it says nothing."""

    side: str
    end: str
    word: str
    numbered: bool
    helper: bool


def read_name(name: str) -> Label:
    """Split a joint name into side, front or hind, and the word for the part.

    Namespaces (`mixamorig:`, `a|b|`), CamelCase, separators and numbers are all understood.
    """
    side = end = ""
    words: list[str] = []
    numbered = roll = helper = False
    bare = _FORE.sub(lambda match: f"Fore{match[1].lower()}", re.split(r"[:|]", name)[-1])
    for token in _TOKEN.findall(bare):
        token = token.lower()
        if token.isdigit():
            numbered = True
        elif token in _SIDES:
            side = _SIDES[token]
        elif token in _CORNERS:
            side, end = _CORNERS[token]
        elif token in _ENDS:
            end = _ENDS[token]
        elif token in _HELPERS:
            helper = True
        elif token in _NOISE:
            roll = roll or token == "roll"
        else:
            glued, token = _unglue(token)
            side = glued or side
            words.append(token)
    word = "".join(words)
    # A roll bone along a limb is a helper; a robot's hip_roll or ankle_roll is a joint of the leg.
    helper = helper or (roll and word not in ("hip", "ankle"))
    return Label(side, end, word, numbered, helper)


def _unglue(token: str) -> tuple[str, str]:
    """Side and rest of lower-case words such as `lfemur` or `leftupleg`."""
    for prefix in ("left", "right"):
        if token.startswith(prefix) and len(token) > len(prefix):
            return prefix, token[len(prefix) :]
    if token[0] in "lr" and token[1:] in _LEG_WORDS:
        return _SIDES[token[0]], token[1:]
    return "", token


def _weights(
    label: Label, words: dict[str, tuple[float, float, float, float]]
) -> tuple[float, float, float, float] | None:
    if label.helper or not label.side:
        return None
    if label.word == "leg" and label.numbered and words is _LEG_WORDS:
        return _NUMBERED_LEG
    if label.word in words:
        return words[label.word]
    endings = [word for word in words if len(word) >= 4 and label.word.endswith(word)]
    return words[max(endings, key=len)] if endings else None


def names_hips(name: str) -> bool:
    """Whether a name is that of the hips or pelvis, the body's own, not of one leg."""
    label = read_name(name)
    return not label.side and not label.helper and label.word in _HIPS_WORDS


def is_helper(name: str) -> bool:
    """Whether a name is that of a control, IK target, twist bone or end marker."""
    return read_name(name).helper


def legs_by_name(labels: Sequence[str], parents: Sequence[int]) -> dict[str, Chain]:
    """The legs that names tell of, by leg name (one of LEG_NAMES).

    Args:
        labels: (J,) names to read, one a joint.
        parents: (J,) parent indices, -1 for the root.
    """
    found = _limbs(labels, parents, _LEG_WORDS)
    if any(end == "front" for _, end in found) or any(end == "hind" for _, end in found):
        # Beside front legs, legs without a word for their end are the hind ones, and vice versa.
        other = "hind" if any(end == "front" for _, end in found) else "front"
        found = {
            (side, end or other): chain
            for (side, end), chain in found.items()
            if end or (side, other) not in found
        }
    return {f"{side}_{end}" if end else side: chain for (side, end), chain in found.items()}


def arms_by_name(labels: Sequence[str], parents: Sequence[int]) -> dict[str, Chain]:
    """The arms that names tell of, as chains upper arm, forearm, hand, by side."""
    return {side: c for (side, _), c in _limbs(labels, parents, _ARM_WORDS).items()}


def _limbs(
    labels: Sequence[str],
    parents: Sequence[int],
    words: dict[str, tuple[float, float, float, float]],
) -> dict[tuple[str, str], Chain]:
    groups: dict[tuple[str, str], dict[int, tuple[float, float, float, float]]] = {}
    for joint, name in enumerate(labels):
        label = read_name(name)
        weights = _weights(label, words)
        if weights is not None:
            groups.setdefault((label.side, label.end), {})[joint] = weights
    chains: dict[tuple[str, str], Chain] = {}
    for key, weights in groups.items():
        best: tuple[tuple[float, ...], Chain] | None = None
        for joint in weights:
            line = [j for j in _line(joint, parents) if j in weights]
            candidate = _best_chain(line, weights)
            if candidate is not None and (best is None or candidate[0] > best[0]):
                best = candidate
        if best is not None:
            chains[key] = best[1]
    return chains


def _line(joint: int, parents: Sequence[int]) -> list[int]:
    """The joint's ancestors and itself, the root first."""
    line = [joint]
    while parents[line[-1]] >= 0:
        line.append(int(parents[line[-1]]))
    return line[::-1]


def _best_chain(
    line: list[int], weights: dict[int, tuple[float, float, float, float]]
) -> tuple[tuple[float, ...], Chain] | None:
    """The surest chain along one line of ancestors, with its rank.

    Of equals, the first hip and knee (they carry all that follows) and the last ankle (it
    carries the foot) win.
    """
    best: tuple[tuple[float, ...], Chain] | None = None
    for parts in (3, 4):
        for at in combinations(range(len(line)), parts):
            scores = [weights[line[i]][part] for part, i in enumerate(at)]
            if min(scores) <= 0.0:
                continue
            toe = at[_TOE] if parts == 4 else 0
            rank = (sum(scores), -at[_HIP], -at[_KNEE], at[_ANKLE], -toe)
            if best is None or rank > best[0]:
                joints = [line[i] for i in at]
                chain = (joints[0], joints[1], joints[2], joints[3] if parts == 4 else -1)
                best = (rank, chain)
    return best


_TYPICAL = {
    "thigh": (("UpLeg", "thigh", "UpperLeg", "femur"), _HIP),
    "shin": (("Leg", "shin", "LowerLeg", "calf", "tibia", "knee"), _KNEE),
    "foot": (("Foot", "ankle"), _ANKLE),
}
_ANY = (1.0, 1.0, 1.0, 1.0)  # a word that is not known may be any part


def nearest_guesses(names: Sequence[str]) -> list[str]:
    """For each part of a left and a right leg, which joint's name comes nearest, for a message."""
    read = [(name, read_name(name)) for name in names]
    lines = []
    for side in ("left", "right"):
        for part, (words, index) in _TYPICAL.items():
            spellings = [
                text.casefold()
                for word in words
                for text in (f"{side}{word}", f"{side}_{word}", f"{word}_{side[0]}", side[0] + word)
            ]
            scored = [
                (difflib.SequenceMatcher(None, spelling, name.casefold()).ratio(), name)
                for name, label in read
                if label.side in (side, "") and _LEG_WORDS.get(label.word, _ANY)[index] > 0
                for spelling in spellings
            ]
            score, name = max(scored, default=(0.0, ""))
            lines.append(f"{side} {part} {name!r}" if score >= 0.7 else f"{side} {part} none")
    return lines
