"""Numbers out of text, fast and to the last bit: white space between them, nothing else allowed.

A decimal of up to 15 digits or so and a small power of ten are both exact in float64, so that one
division rounds as correctly as Python's own float() does; every other word is left to float().
"""

from __future__ import annotations

import re

import numpy as np
from numpy.typing import NDArray

from footik_runtime.compiled import compiled

NUMERIC = re.compile(
    rb"[+-]?+(?:(?:\d++\.?+\d*+|\.\d++)(?:e[+-]?+\d++)?+|nan|inf(?:inity)?+)", re.IGNORECASE
)
"""What a number looks like. Its quantifiers are possessive: linear, whatever it is given."""

_WORD = re.compile(rb"\S++")
_EXACT_POWERS = np.array([10.0**n for n in range(23)])


def read_numbers(text: bytes) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """The numbers of a text, and the byte at which each word begins.

    The numbers stop before the first word that is not one, so that fewer numbers than words tell
    where it is.
    """
    letters = np.frombuffer(text, dtype=np.uint8)
    words = _count_words(letters)
    values, begins = np.empty(words), np.empty(words, dtype=np.int64)
    plain = np.empty(words, dtype=np.bool_)
    _scan(letters, _EXACT_POWERS, values, begins, plain)
    for n in np.flatnonzero(~plain).tolist():
        word = _WORD.match(text, int(begins[n]))
        if word is None or not NUMERIC.fullmatch(word.group()):
            return values[:n], begins
        values[n] = float(word.group())
    return values, begins


@compiled
def _blank(letter):
    return letter == 32 or 9 <= letter <= 13


@compiled
def _count_words(letters):
    words = 0
    blank = True
    for letter in letters:
        now = _blank(letter)
        if blank and not now:
            words += 1
        blank = now
    return words


@compiled
def _scan(letters, powers, values, begins, plain):
    """Each word's beginning, and its value where it is a plain decimal that one division makes."""
    at, end = 0, len(letters)
    for n in range(len(values)):
        while _blank(letters[at]):
            at += 1
        begins[n] = at
        negative = letters[at] == 45
        if negative or letters[at] == 43:
            at += 1
        mantissa, digits, decimals = 0, 0, 0
        point, good = False, True
        while at < end and not _blank(letters[at]):
            digit = int(letters[at]) - 48
            if 0 <= digit <= 9:
                digits += 1
                if mantissa < 100_000_000_000_000_000:  # beyond, it is too long in any case
                    mantissa = mantissa * 10 + digit
                decimals += point
            elif letters[at] == 46 and not point:
                point = True
            else:
                good = False
            at += 1
        good = good and digits > 0 and decimals <= 22 and mantissa <= 2**53
        plain[n] = good
        if good:
            value = float(mantissa) / powers[decimals]
            values[n] = -value if negative else value
