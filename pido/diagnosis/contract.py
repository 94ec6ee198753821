"""The files of a diagnosis: `diagnosis.json` and `parts/<part>.parquet` to the letter of the contract.

In:  a Diagnosis, or what `correct` returned for one part.
Out: files that outside tools read. What the contract has no place for (bins, NC blocks, what was rejected, what to
     record next) goes to `details.json`; the models that `pido correct` applies go to `model.json`.
A former diagnosis is there until all of this one is written; `diagnosis.json` comes last, and who sees it sees a
complete folder.
"""

from __future__ import annotations

import json
import math
import os
import re
import shutil
import threading
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from pido.core.arrays import Float1D
from pido.core.errors import DiagnosisError
from pido.core.files import replacing, write_atomically
from pido.core.names import file_name
from pido.diagnosis.finding import ByPart, Diagnosis, Finding, PartSeries
from pido.diagnosis.pair import pair_of

SCHEMA = "pido.diagnosis/1"
ANSWER, DETAILS, MODEL = "diagnosis.json", "details.json", "model.json"
_LONGEST_NAME = 215  # of the 255 bytes that a file system takes: the rest is for the ending, and while it is written
NOTES = "pido.notes"
MODEL_SCHEMA = "pido.diagnosis.model/1"


def as_contract(diagnosis: Diagnosis) -> dict[str, Any]:
    """The content of `diagnosis.json`."""
    return {
        "schema": SCHEMA,
        "findings": [_finding(f) for f in diagnosis.findings],
        "clean_axes": list(diagnosis.clean_axes),
    }


def as_details(diagnosis: Diagnosis) -> dict[str, Any]:
    """What the contract has no place for, in the same order of findings."""
    return {
        "findings": [
            {
                "axis": f.axis,
                "mechanism": f.mechanism,
                "voxels": [list(v) for v in f.where.voxels],
                "nc_lines": list(f.where.nc_lines),
                "workpiece": f.where.workpiece,
                "said": f.said,
                "faults": [asdict(fault) for fault in f.where.faults],
                "factor": None if f.factor is None else {"value": f.factor.value, "ci95": list(f.factor.ci95)},
                "factor_by_part": None if f.by_part is None else _by_part(f.by_part),
                "to_tell_apart": {a.mechanism: a.to_tell_apart for a in f.alternatives if a.to_tell_apart},
                "to_record": f.to_record,
            }
            for f in diagnosis.findings
        ],
        "rejected": [{"axis": r.axis, "mechanism": r.mechanism, "reason": r.reason} for r in diagnosis.rejected],
        "notes": list(diagnosis.notes),
        "pair": diagnosis.model.get("pair"),
        "unit": unit_of_series(diagnosis.model),
    }


def write(diagnosis: Diagnosis, folder: Path, **more: str) -> None:
    """All files of a diagnosis into `folder`, which is made if it is not there; those of a former one there go once all
    are written. more : content of further files, by name.
    """
    unit = unit_of_series(diagnosis.model)
    with _taking_their_place(folder) as place:
        for part, series in diagnosis.parts.items():
            write_series(series, place / "parts" / f"{file_name(part)}.parquet", unit)
        write_json({"schema": MODEL_SCHEMA, **diagnosis.model}, place / MODEL)
        write_json(as_details(diagnosis), place / DETAILS)
        for name, content in more.items():
            write_atomically(place / name, content)
        write_json(as_contract(diagnosis), place / ANSWER)


def check_place(folder: Path, *more: str) -> None:
    """Raises DiagnosisError where a diagnosis in `folder` would take the place of what is none.

    more : names of further files, as `write` takes them
    """
    parts = folder / "parts"
    there = [folder / name for name in (ANSWER, DETAILS, MODEL, *more) if (folder / name).exists()]
    series = sorted(parts.glob("*.parquet"))
    foreign = [parts] if parts.exists() and not parts.is_dir() else []
    foreign += [*there, *series] if not _is_model(folder / MODEL) else [f for f in series if not _is_series(f)]
    if foreign:
        raise DiagnosisError(
            f"--out {folder}: {foreign[0]} is there already and belongs to no diagnosis. Name another place, or move "
            "it away."
        )


def check_names(parts: Iterable[str]) -> None:
    """Raises DiagnosisError for a part whose identifier is longer than a file name may be."""
    for part in parts:
        if (size := len(file_name(part))) > _LONGEST_NAME:
            raise DiagnosisError(
                f"part {part[:30]}…: its identifier makes a file name of {size} bytes; at most {_LONGEST_NAME} are "
                "possible. Shorten 'part' in part.json."
            )


@contextmanager
def _taking_their_place(folder: Path) -> Iterator[Path]:
    """A place to write to. When the block ends, the series and files there take the place of those in `folder`, what
    else lies there stays; where the block fails, all stays as it was. The model comes first: by it a folder is known
    as that of a diagnosis, also one that was not finished."""
    there = folder.exists()
    folder.mkdir(parents=True, exist_ok=True)
    place = folder / f".{os.getpid()}-{threading.get_ident()}.new"
    try:
        (place / "parts").mkdir(parents=True)
        yield place
        (folder / "parts").mkdir(exist_ok=True)
        (folder / ANSWER).unlink(missing_ok=True)
        for former in filter(_is_series, (folder / "parts").glob("*.parquet")):
            former.unlink()
        files = [p.relative_to(place) for p in place.rglob("*") if p.is_file()]
        files.sort(key=lambda p: (p == Path(ANSWER), p != Path(MODEL)))
        for file in files:
            (place / file).replace(folder / file)
    finally:
        shutil.rmtree(place, ignore_errors=True)
        if not there and not any(folder.iterdir()):
            folder.rmdir()


def read_model(folder: Path) -> dict[str, Any]:
    """The models of a diagnosis folder, as `pido.diagnosis.correct` takes them."""
    path = folder / MODEL
    try:
        model = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise DiagnosisError(f"{path}: no such file. Run 'pido diagnose PART ... --out {folder}' first.") from None
    except ValueError as error:
        raise DiagnosisError(f"{path}: not readable as JSON ({error}). Run 'pido diagnose' again.") from None
    if not isinstance(model, dict) or model.pop("schema", None) != MODEL_SCHEMA:
        raise DiagnosisError(f"{path}: not a model of schema {MODEL_SCHEMA}. Run 'pido diagnose' with this version.")
    return model


def unit_of_series(model: Mapping[str, object]) -> str:
    """Of mismatch and corrected signal: A, or the unit of the pair of columns that was compared."""
    pair = pair_of(model)
    return "A" if pair is None else pair.unit


def write_series(series: PartSeries, path: Path, unit: str = "A", notes: Sequence[str] = ()) -> None:
    """One part sample by sample: `time`, `mismatch_<axis>`, `mismatch_score_<axis>`, `curr_<axis>_corrected`.

    The unit of each column stands in its field's metadata, as in recordings that pido writes.
    notes : what a reader of these columns has to know, kept in the file's metadata under `pido.notes` as a JSON list
    """
    columns: dict[tuple[str, str], Float1D] = {("time", "s"): series.time}
    for axis in series.corrected:
        columns[f"mismatch_{axis}", unit] = series.mismatch[axis]
        columns[f"mismatch_score_{axis}", "–"] = series.score[axis]
        columns[f"curr_{axis}_corrected", unit] = series.corrected[axis]
    schema = pa.schema([pa.field(name, pa.float64(), metadata={"unit": u}) for name, u in columns])
    if notes:
        schema = schema.with_metadata({NOTES: json.dumps([*notes], ensure_ascii=False)})
    with replacing(path) as temporary:
        pq.write_table(pa.Table.from_arrays([pa.array(v) for v in columns.values()], schema=schema), temporary)


def is_series(columns: Collection[str]) -> bool:
    """Whether these are the columns that `write_series` writes."""
    own = re.compile(r"time|mismatch_(score_)?[a-z]+|curr_[a-z]+_corrected")
    return all(map(own.fullmatch, columns)) and any(name.startswith("mismatch_score_") for name in columns)


def write_json(data: Mapping[str, Any], path: Path) -> None:
    """`data` as one JSON file; a number that is not finite becomes null."""
    write_atomically(path, json.dumps(_finite(data), indent=2, allow_nan=False, ensure_ascii=False))


def _is_model(file: Path) -> bool:
    try:
        return json.loads(file.read_bytes())["schema"].startswith("pido.diagnosis.model/")
    except (OSError, ValueError, LookupError, TypeError, AttributeError):
        return False


def _is_series(file: Path) -> bool:
    try:
        return is_series(pq.read_schema(file).names)
    except (pa.ArrowException, OSError):
        return False


def _finding(f: Finding) -> dict[str, Any]:
    return {
        "axis": f.axis,
        "mechanism": f.mechanism,
        "kind": f.kind,
        "equation": f.equation,
        "parameters": {
            name: {"value": e.value, "unit": e.unit, "ci95": list(e.ci95)} for name, e in f.parameters.items()
        },
        "where": {
            "summary": f.where.summary,
            "conditions": list(f.where.conditions),
            "intervals": [
                {"part": i.part, "t_start": i.t_start, "t_end": i.t_end, "score": i.score} for i in f.where.intervals
            ],
        },
        "evidence": {
            "p_value": f.evidence.p_value,
            "q_value": f.evidence.q_value,
            "delta_bic": f.evidence.delta_bic,
        },
        "fit": {
            "scheme": f.fit.scheme,
            "rmse_before": f.fit.rmse_before,
            "rmse_after": f.fit.rmse_after,
            "r2_before": f.fit.r2_before,
            "r2_after": f.fit.r2_after,
            "p_value": f.fit.p_value,
        },
        "replaces": list(f.replaces),
        "alternatives": [{"mechanism": a.mechanism, "delta_bic": a.delta_bic} for a in f.alternatives],
    }


def _by_part(found: ByPart) -> dict[str, Any]:
    return {
        "differs": found.differs,
        "p_value": found.p_value,
        "spread": found.spread,
        "parts": {part: {"value": e.value, "ci95": list(e.ci95)} for part, e in found.factors.items()},
    }


def _finite(data: Any) -> Any:
    if isinstance(data, Mapping):
        return {key: _finite(value) for key, value in data.items()}
    if isinstance(data, list | tuple):
        return [_finite(value) for value in data]
    if hasattr(data, "item"):
        data = data.item()
    return None if isinstance(data, float) and not math.isfinite(data) else data
