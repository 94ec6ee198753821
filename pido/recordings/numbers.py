"""Rows of numbers out of JSON text, without a Python number for each cell.

In:  one line `{"HFData":[[1,2.5,...],[...]]}` and the columns that are wanted. Out: those columns, or None.

A capture has 60 columns of which 9 are needed. All of the text is checked against JSON's grammar, but only what is
needed is converted. Whatever is not such a table of decimal numbers, or cannot be converted here without rounding
twice, is None: a general parser reads it, and knows what is wrong with it.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numba import njit

from pido.core.arrays import Array1D, Float1D, Float2D, Int1D

_BEGIN = b'{"HFData":'
_EXACT = 2**53
_TENS = np.array([10.0**k for k in range(23)])
"""Whole numbers up to 2^53 and powers of ten up to 10^22 are exact, so their product or quotient is rounded once, as
any parser rounds (Clinger, PLDI 1990)."""


def table(line: bytes, width: int, wanted: Sequence[int]) -> Float2D | None:
    """(n, len(wanted)): these columns of the rows in `line`, every one of `width` numbers; None for any other line.

    >>> table(b'{"HFData":[[7,0.5,-1E-3],[8,0.25,2]]}', 3, (0, 2)).tolist()
    [[7.0, -0.001], [8.0, 2.0]]
    >>> table(b'{"HFData":[[7,0.5],[8]]}', 2, (0, 1)) is None
    True
    """
    if not (line.startswith(_BEGIN) and line.endswith(b"}")):
        return None
    columns, place = np.unique(wanted, return_inverse=True)
    text, into = np.frombuffer(line, np.uint8), np.full(width, -1)
    into[columns] = np.arange(len(columns))
    out = np.empty((len(text) // (2 * width) + 1, len(columns)))  # a number and its comma are two bytes or more
    rows = _scan(text, len(_BEGIN), into, _TENS, out)
    return out[:rows, place] if rows > 0 else None


@njit(nogil=True, cache=True)
def _scan(text: Array1D, i: int, into: Int1D, tens: Float1D, out: Float2D) -> int:
    """Number of rows, or -1. The text ends with a brace, which nothing here steps over: no index runs beyond it."""
    space, minus, zero, dot = 32, 45, 48, 46
    while text[i] == space:
        i += 1
    if text[i] != 91:  # [
        return -1
    i, rows, width = i + 1, 0, len(into)
    while True:
        while text[i] == space:
            i += 1
        if text[i] != 91:
            return -1
        i += 1
        for column in range(width):
            while text[i] == space:
                i += 1
            negative = text[i] == minus
            if negative:
                i += 1
            first, digits, value, tenth = i, 0, 0, 0
            while zero <= text[i] <= 57:
                value = 10 * value + (text[i] - zero)
                i += 1
            digits = i - first
            if digits == 0 or (digits > 1 and text[first] == zero):
                return -1
            if text[i] == dot:
                i += 1
                first = i
                while zero <= text[i] <= 57:
                    value = 10 * value + (text[i] - zero)
                    i += 1
                tenth = first - i
                digits -= tenth
                if tenth == 0:
                    return -1
            if text[i] == 101 or text[i] == 69:  # e, E
                i += 1
                sign = -1 if text[i] == minus else 1
                if text[i] == minus or text[i] == 43:  # +
                    i += 1
                first, power = i, 0
                while zero <= text[i] <= 57 and i - first < 2:
                    power = 10 * power + (text[i] - zero)
                    i += 1
                if i == first:
                    return -1
                tenth += sign * power
            if digits > 18:  # beyond it `value` overflows
                return -1
            if into[column] >= 0:
                if value > _EXACT or abs(tenth) > 22:
                    return -1
                number = value / tens[-tenth] if tenth < 0 else value * tens[tenth]
                out[rows, into[column]] = -number if negative else number
            while text[i] == space:
                i += 1
            if text[i] != (93 if column == width - 1 else 44):  # ] or ,
                return -1
            i += 1
        rows += 1
        while text[i] == space:
            i += 1
        if text[i] == 44:
            i += 1
            continue
        if text[i] != 93:
            return -1
        i += 1
        while text[i] == space:
            i += 1
        return rows if i == len(text) - 1 else -1
