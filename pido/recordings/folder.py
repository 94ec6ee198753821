"""Our own part folder: recording.parquet in the contract's columns, part.json beside it.

In:  the folder. Out: a Recording; and the other way round (`write_folder`).
A missing or misspelt key of part.json is refused by name; columns without a place in the contract are kept where they
are numbers, and named in a note whatever they are (`check` refuses them for the store).
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import orjson
import pyarrow as pa
import pyarrow.parquet as pq
from pydantic import ValidationError

from pido.core.arrays import Array1D
from pido.core.columns import UNITS
from pido.core.errors import RecordingError, SettingsError
from pido.core.files import replacing, write_atomically
from pido.core.part import GIVEN, PartInfo
from pido.core.recording import Recording
from pido.recordings.reader import UNKNOWN, Reader, contract_names, head, of_machine

DATA, ABOUT = "recording.parquet", "part.json"


def _recognises(path: Path) -> bool:
    if path.is_dir():
        return (path / DATA).exists() or (path / ABOUT).exists()
    return path.name == DATA or head(path, 4) == b"PAR1" or path.suffix.lower() == ".parquet"


def _data(path: Path) -> Path:
    return path / DATA if path.is_dir() else path


def says_machine(path: Path) -> bool:
    """Whether a part.json says what machine a recording is of; other readers assume one."""
    return _recognises(path) and _data(path).with_name(ABOUT).is_file()


def _read(path: Path, machine: str | None, channels: Mapping[str, str]) -> Recording:
    data = _data(path)
    about = data.with_name(ABOUT)
    for file in (data, about):
        if file.exists() and not file.is_file():
            raise RecordingError(f"{file}: is no file, but a folder or device. Put the file of this name in its place.")
    if not data.exists():
        raise RecordingError(f"{path}: has {ABOUT} but no {DATA}. Copy the whole folder.")
    notes: tuple[str, ...] = ()
    if about.exists():
        part = read_part(about)
    elif path.is_dir():
        raise SettingsError(f"{path}: has no {ABOUT}. Write one with at least 'part' and 'machine'.")
    else:
        machine, notes = of_machine(machine, "unknown", "having no part.json")
        part = PartInfo(part=data.stem, machine=machine)
    columns, unknown = read_columns(data)
    if unknown:
        notes = (*notes, f"{UNKNOWN}{', '.join(unknown)}")
    return Recording(part=part, columns=columns, notes=notes)


def read_part(path: Path) -> PartInfo:
    """`part.json`. Raises SettingsError with every fault and its place."""
    text = path.read_bytes()
    try:
        orjson.loads(text)  # says line and column, and refuses what is no number
        return PartInfo.model_validate(json.loads(text, object_pairs_hook=_once), context=GIVEN)
    except _Twice as key:
        raise SettingsError(f"{path}: the key '{key}' stands in it twice. Keep the one that is right.") from None
    except RecursionError:
        raise SettingsError(f"{path}: nested too deeply. Write it again.") from None
    except orjson.JSONDecodeError as error:
        raise SettingsError(f"{path}: not JSON: {error}. Correct it or write it again.") from None
    except ValidationError as error:
        faults = "\n".join(
            f"  {'.'.join(map(str, e['loc'])) or '(top)'}: {e['msg'].removeprefix('Value error, ')}"
            for e in error.errors()
        )
        raise SettingsError(
            f"{path}: {error.error_count()} fault(s); the known keys are {', '.join(PartInfo.model_fields)}:\n{faults}"
        ) from None


class _Twice(Exception):
    """A key that comes twice in one object."""


def _once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    content = dict(pairs)
    if len(content) < len(pairs):
        names = [name for name, _ in pairs]
        raise _Twice(next(name for name in names if names.count(name) > 1))
    return content


def read_columns(path: Path) -> tuple[dict[str, Array1D], list[str]]:
    """(columns under their contract names, names that the contract does not know) of a Parquet file."""
    try:
        table = pq.read_table(path)
    except (pa.ArrowInvalid, pa.ArrowException, OSError) as error:
        if isinstance(error, OSError) and error.errno is not None:
            raise  # the disk's, not the file's
        raise RecordingError(
            f"{path}: damaged or cut off, not readable as Parquet: {str(error).splitlines()[0]} Copy it again."
        ) from None
    if table.num_rows == 0:
        raise RecordingError(f"{path}: holds no samples. Export the recording again.")
    names = contract_names([str(name) for name in table.column_names], path)
    columns: dict[str, Array1D] = {}
    unknown = [name for name in names if name not in UNITS and not name.startswith("__index")]
    for name, field in zip(names, table.schema, strict=True):
        if name.startswith("__index"):
            continue
        values = table.column(field.name)
        if pa.types.is_dictionary(values.type):  # pandas' categories
            values = values.cast(values.type.value_type)
        if name == "tool_id" and _is_text(values):
            columns[name] = np.asarray(values.to_pylist(), dtype=object)
        elif name in UNITS:
            columns[name] = _numbers(values, name, path)
        else:
            with suppress(RecordingError):  # the note names it
                columns[name] = _numbers(values, name, path)
    return columns, unknown


def _is_text(values: pa.ChunkedArray) -> bool:
    kind = values.type
    return pa.types.is_string(kind) or pa.types.is_large_string(kind) or pa.types.is_string_view(kind)


def _numbers(values: pa.ChunkedArray, name: str, path: Path) -> Array1D:
    """As float64. Raises RecordingError for what is no number, or loses digits."""
    if _is_text(values):
        raise RecordingError(f"{path}: column '{name}' holds text; it must be numbers in {UNITS.get(name)}.")
    try:
        return np.array(values.cast(pa.float64()).to_numpy(), dtype=float)
    except (pa.ArrowInvalid, pa.ArrowNotImplementedError):
        if pa.types.is_integer(values.type):
            raise RecordingError(
                f"{path}: column '{name}' holds whole numbers beyond 2^53, which lose digits as float64. Count it "
                "from its first value, or in a coarser unit."
            ) from None
        raise RecordingError(f"{path}: column '{name}' is {values.type}; it must be numbers.") from None


def write_columns(recording: Recording, path: Path) -> None:
    """The columns as Parquet, float64, in their order; the file is replaced whole."""
    arrays = {
        name: pa.array(values, type=pa.string()) if values.dtype == object else pa.array(np.asarray(values, float))
        for name, values in recording.columns.items()
    }
    with replacing(path) as temporary:
        pq.write_table(pa.table(arrays), temporary, compression="zstd")


def write_folder(recording: Recording, path: Path) -> Path:
    """A part folder that reads back as the same recording."""
    write_columns(recording, path / DATA)
    about = recording.part.model_dump(mode="json", exclude_none=True, exclude_defaults=True)
    write_atomically(path / ABOUT, orjson.dumps(about, option=orjson.OPT_INDENT_2))
    return path


READER = Reader(
    name="part folder",
    layout=f"a folder with {DATA} and {ABOUT}",
    recognises=_recognises,
    read=_read,
)
