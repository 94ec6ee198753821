"""CSV files by column: only what is needed is parsed.

In:  a path and the columns wanted. Out: float64 arrays; an empty cell is NaN.
"""

from __future__ import annotations

import csv
from collections.abc import Iterable
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.compute as compute
import pyarrow.csv as pc

from pido.core.arrays import Array1D
from pido.core.errors import RecordingError
from pido.recordings.reader import csv_header

_BLOCK = 1 << 21
"""Bytes parsed at once by one thread; pyarrow's own 1 MiB makes more chunks, and so more to join, than needed."""

_MISSING = ["", "NA", "NaN", "nan", "null", "None"]


def read_csv(
    path: Path, columns: Iterable[str], text: Iterable[str] = (), others: Iterable[str] = ()
) -> dict[str, Array1D]:
    """`columns` as float64 (n,), `text` as objects, and those of `others` that hold numbers throughout.

    An empty cell is NaN, or None in a text.
    Raises RecordingError naming line or column of the first fault.
    """
    columns, text, others = list(columns), list(text), list(others)
    types = {**dict.fromkeys(columns, pa.float64()), **dict.fromkeys(text, pa.string())}
    try:
        table = pc.read_csv(
            path,
            read_options=pc.ReadOptions(block_size=_BLOCK, column_names=csv_header(path), skip_rows=1),
            convert_options=pc.ConvertOptions(
                include_columns=columns + text + others,
                column_types=types,
                null_values=_MISSING,
                strings_can_be_null=True,
            ),
        )
    except (pa.ArrowInvalid, pa.ArrowKeyError) as error:
        reason = _uneven(path) or " ".join(_no_numbers(path, columns)) or f"cannot be read as CSV: {error}."
        raise RecordingError(f"{path}: {reason} Export the recording again.") from None
    if table.num_rows == 0:
        raise RecordingError(f"{path}: the file has column names but no rows. Export the recording again.")
    kept = [name for name in others if _is_number(table.schema.field(name).type)]
    return {
        name: _owned(
            compute.call_function("utf8_trim_whitespace", [table.column(name)]).to_numpy()
            if name in text
            else table.column(name).cast(pa.float64(), safe=False).to_numpy()
        )
        for name in columns + text + kept
    }


def _is_number(kind: pa.DataType) -> bool:
    return pa.types.is_integer(kind) or pa.types.is_floating(kind)


def _uneven(path: Path) -> str:
    """The first line that has not as many cells as there are columns, '' where all have; pyarrow does not say which."""
    wide = len(csv_header(path))
    try:
        with path.open(encoding="utf-8", newline="") as file:
            lines = csv.reader(file)
            next(lines)
            for cells in lines:
                if cells and len(cells) != wide:
                    number = lines.line_num
                    cut = ": the file may have been cut off there" if len(cells) < wide and not any(lines) else ""
                    return f"line {number} has {len(cells)} of {wide} columns{cut}."
    except (UnicodeDecodeError, csv.Error):
        pass  # not a table at all: others say more
    return ""


def _no_numbers(path: Path, columns: list[str]) -> list[str]:
    """The first line of each column that should hold numbers and does not; pyarrow says neither name nor line."""
    import pandas as pd

    try:
        header = csv_header(path)
        at = sorted(map(header.index, columns))
        table = pd.read_csv(path, usecols=at, dtype=str, keep_default_na=False, skip_blank_lines=False)
        table.columns = [header[i] for i in at]
    except ValueError:  # not a table at all: pyarrow's own words say more
        return []
    said = []
    for name in columns:
        given = table[name].notna() & ~table[name].isin(_MISSING)
        bad = np.isnan(np.asarray(pd.to_numeric(table[name], errors="coerce"), float)) & np.asarray(given, bool)
        if bad.any():
            row = int(bad.argmax())
            often = f", {bad.sum()} times in all" if bad.sum() > 1 else ""
            said.append(f"in line {row + 2} '{name}' is {table[name].iloc[row]!r}, which is no number{often}.")
    return said


def _owned(values: Array1D) -> Array1D:
    """An array that may be written to: several chunks were copied into one already, a single one is still Arrow's."""
    return values if values.flags.writeable else values.copy()
