"""Rows of numbers out of JSON text, without a Python number for each cell.

In:  one line `{"HFData":[[1,2.5,...],[...]]}` and the columns that are wanted. Out: those columns, or None.

simdjson checks and converts the whole line and hands over one array. Whatever is not such a table is None: a general
parser reads it, and says what is wrong with it.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from simdjson import Array, Object, Parser

from pido.core.arrays import Float2D

_BEGIN = b'{"HFData":'


def table(line: bytes, width: int, wanted: Sequence[int], parser: Parser) -> Float2D | None:
    """(n, len(wanted)): these columns of the rows in `line`, every one of `width` numbers; None for any other line.

    parser : reused from line to line

    >>> table(b'{"HFData":[[7,0.5,-1E-3],[8,0.25,2]]}', 3, (0, 2), Parser()).tolist()
    [[7.0, -0.001], [8.0, 2.0]]
    >>> table(b'{"HFData":[[7,0.5],[8]]}', 2, (0, 1), Parser()) is None
    True
    """
    if not line.startswith(_BEGIN):
        return None
    try:
        message = parser.parse(line)
        if not isinstance(message, Object) or list(message.keys()) != ["HFData"]:
            return None
        rows = message["HFData"]
        # A list in place of a number would be taken for its numbers.
        if not isinstance(rows, Array) or line.count(b"[") != len(rows) + 1:
            return None
        if not rows or not all(isinstance(row, Array) and len(row) == width for row in rows):
            return None
        cells = np.frombuffer(rows.as_buffer(of_type="d"))
    except (ValueError, TypeError, RuntimeError):  # no JSON, a cell that is no number, a whole number beyond 64 bits
        return None
    return cells.reshape(-1, width)[:, list(wanted)]
