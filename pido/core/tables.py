"""Tables of other libraries, in and out: pandas, polars, Arrow, or a mapping of arrays.

In:  any table that speaks the Arrow C stream protocol, or a mapping. Out: arrays by name; and back into the same kind.
Units go with the columns where the library has a place for them: Arrow fields (`unit`) and pandas (`attrs["units"]`).
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from pido.core.arrays import Array1D
from pido.core.columns import ALIASES, UNITS
from pido.core.errors import RecordingError


def is_table(table: object) -> bool:
    """Whether it has columns with names (not numbers) that can be read here."""
    if isinstance(table, Mapping):
        return not hasattr(table, "toarray")  # scipy's dok_matrix is a dict
    names = getattr(table, "column_names", None) or getattr(table, "columns", None)
    return hasattr(table, "__arrow_c_stream__") and names is not None and all(isinstance(n, str) for n in names)


def names_of(table: Any) -> tuple[str, ...]:
    """Its columns' names as they stand there, in the order of `columns_of`.

    >>> names_of({"f_x": [1.0], "v_x": [2.0]})
    ('f_x', 'v_x')
    """
    names = table if isinstance(table, Mapping) else getattr(table, "column_names", None) or table.columns
    return tuple(name for name in map(str, names) if not name.startswith("__index_level"))


def columns_of(table: Any) -> dict[str, Array1D]:
    """Columns by their contract names: numbers as float64 (a missing value is NaN), text as objects.

    Raises RecordingError for what is no table, or a column that holds neither numbers nor text.
    """
    if isinstance(table, Mapping):
        return {ALIASES.get(str(name), str(name)): _plain(str(name), values) for name, values in table.items()}
    if not is_table(table):
        raise RecordingError(f"{type(table).__name__} is no table: give pandas, polars, Arrow, or a mapping of arrays.")
    import pyarrow as pa

    arrow = pa.table(table)
    names = [ALIASES.get(name, name) for name in names_of(arrow)]
    if len(set(names)) < len(names):
        raise RecordingError(f"columns stand twice in the table: {sorted({n for n in names if names.count(n) > 1})}.")
    return {name: _column(name, arrow.column(k)) for k, name in enumerate(names)}


def like(table: Any, columns: Mapping[str, Array1D]) -> Any:
    """`columns` in the library that `table` is of; a mapping where that is a mapping or an array."""
    module = type(table).__module__.split(".")[0]
    return table_of(columns, module) if module in ("pandas", "polars", "pyarrow") else dict(columns)


def column_like(column: Any, values: Array1D) -> Any:
    """`values` as one column of the library that `column` is of, under its name; as they are where it is of none."""
    match type(column).__module__.split(".")[0]:
        case "pandas":
            import pandas as pd

            return pd.Series(values, name=column.name)
        case "polars":
            import polars as pl

            return pl.Series(column.name, values)
        case "pyarrow":
            import pyarrow as pa

            return pa.chunked_array([values]) if isinstance(column, pa.ChunkedArray) else pa.array(values)
    return values


def table_of(columns: Mapping[str, Array1D], library: str = "pandas") -> Any:
    """A table of 'pandas', 'polars' or 'pyarrow', with units where the library has a place for them."""
    if library == "pandas":
        import pandas as pd

        frame = pd.DataFrame(dict(columns))
        frame.attrs["units"] = {name: UNITS[name] for name in columns if name in UNITS}
        return frame
    import pyarrow as pa

    fields, arrays = [], []
    for name, values in columns.items():
        array = pa.array(values.tolist(), pa.string()) if values.dtype == object else pa.array(values)
        unit = {"unit": UNITS[name]} if name in UNITS else None
        fields.append(pa.field(name, array.type, metadata=unit))
        arrays.append(array)
    arrow = pa.Table.from_arrays(arrays, schema=pa.schema(fields))
    if library == "pyarrow":
        return arrow
    if library == "polars":
        import polars as pl

        return pl.DataFrame(arrow)
    raise RecordingError(f"no tables of '{library}'; there are pandas, polars and pyarrow.")


def _column(name: str, values: Any) -> Array1D:
    import pyarrow as pa

    kind = values.type
    if pa.types.is_dictionary(kind):
        values = values.cast(kind.value_type)
        kind = values.type
    if pa.types.is_string(kind) or pa.types.is_large_string(kind) or pa.types.is_string_view(kind):
        return np.asarray(values.to_pylist(), dtype=object)
    if not (pa.types.is_integer(kind) or pa.types.is_floating(kind) or pa.types.is_boolean(kind)):
        raise RecordingError(f"column '{name}' is {kind}; it must be numbers{_in_unit(name)}, or text.")
    return np.array(values.cast(pa.float64()).to_numpy(), dtype=float)


def _plain(name: str, values: Any) -> Array1D:
    array = np.asarray(values)
    if array.dtype.kind in "OUS":
        return array.astype(object)
    if array.dtype.kind not in "biuf":
        raise RecordingError(f"column '{name}' is {array.dtype}; it must be numbers{_in_unit(name)}, or text.")
    return array.astype(float)


def _in_unit(name: str) -> str:
    return f" in {UNITS[name]}" if name in UNITS else ""
