"""What the physical equation is worth with the physics that the mismatch finder adds to it (past the paper).

In:  one recording that repeats a program, or a folder of recordings of one machine.
Out: errors on rows that no fit had seen, of the equation as printed, with what was found, and of trees: each run left
     out once; the diagonals of the plane left out of every run; the last third of every run left out.

Mechanisms are found, confirmed and fitted anew in every fold, on its training rows alone. A diagnosis works on time
series, so hidden rows stay in their recording without their currents. Axes are those that feed while cutting.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from pido import config
from pido.core.arrays import Bool1D, Float2D
from pido.core.axes import AXES, LINEAR_AXES
from pido.core.columns import CURRENT, TIME
from pido.core.machining import Machine
from pido.core.recording import Recording
from pido.core.samples import Samples
from pido.diagnosis.correct import correct
from pido.diagnosis.diagnose import diagnose
from pido.equations.fit import fit_global
from pido.experiments.base import Outcome, Shown
from pido.experiments.data import DataError, read_each, rows_of, runs, varies
from pido.feature_space.regional import sectors
from pido.models.axis_models import AxisModels
from pido.recordings import READERS

log = logging.getLogger(__name__)

PRINTED, FOUND, TREES, TREES_HELD = "equation as printed", "equation with what was found", "trees", "trees + direction"
RUN_OUT, DIAGONALS, LAST_THIRD = "one run left out", "diagonals left out", "last third left out"
ASKED = {(RUN_OUT, "x"): 0.042, (RUN_OUT, "y"): 0.032, (LAST_THIRD, "x"): 0.050, (LAST_THIRD, "y"): 0.040}
"""A: what the air cut of a DMC 60H is asked to reach; the last third of its program goes along unseen diagonals."""
_DIAGONAL = (1, 3, 5, 7)
_FEEDS = 0.05


@dataclass(frozen=True, eq=False)
class Run:
    """A stretch of recording, its rows to learn from (`row` counts within the stretch)."""

    recording: Recording
    samples: Samples


def run(
    path: Path,
    *,
    machine: str | None = None,
    quick: bool = False,
    seed: int = 0,
    on_progress: Callable[[int, int, str], None] = lambda done, of, what: None,
) -> Outcome:
    """Measure all splits (`quick`: the first run left out alone).

    Raises DataError where runs are too few, or no axis can be judged.
    """
    mill, each, notes = _runs(path, machine)
    axes = _feeding(each, mill)
    if not axes:
        raise DataError(f"{path}: no linear axis that feeds has a current that changes. {' '.join(notes)}")
    splits = list(_splits(each, quick))
    rows, found = [], []
    for k, (split, train, test) in enumerate(splits):
        on_progress(k, len(splits), split)
        known = [_hidden(r, keep, axes) for r, keep in zip(each, train, strict=True) if keep.any()]
        result = diagnose(known, machine=mill, seed=seed)
        names = {a: ", ".join(f.mechanism for f in result.findings if f.axis == a) or "nothing" for a in axes}
        found += [{"split": split, "fold": k, "axis": a, "found": names[a]} for a in axes]
        learn = Samples.concat([r.samples.take(keep) for r, keep in zip(each, train, strict=True)])
        judged = [(r, keep) for r, keep in zip(each, test, strict=True) if keep.any()]
        asked = Samples.concat([r.samples.take(keep) for r, keep in judged])
        said = {
            PRINTED: fit_global(learn, mill).predict(asked),
            FOUND: np.concatenate([_corrected(result.model, r, keep) for r, keep in judged]),
            TREES: AxisModels.fit(learn, inputs="paper", seed=seed).predict(asked),
            TREES_HELD: AxisModels.fit(learn, seed=seed).predict(asked),
        }
        for model, predicted in said.items():
            square = (asked.currents - predicted) ** 2
            rows += [
                {"split": split, "fold": k, "model": model, "axis": a, "square": float(np.nanmean(square[:, i])),
                 "n": len(asked)}
                for i, a in enumerate(AXES) if a in axes
            ]  # fmt: skip
    on_progress(len(splits), len(splits), "done")
    return _summed_up(pd.DataFrame(rows), pd.DataFrame(found), notes)


def _runs(path: Path, machine: str | None) -> tuple[Machine, list[Run], list[str]]:
    if not path.exists():
        raise DataError(f"{path}: no such file or folder.")
    files = [path] if path.is_file() else sorted(path.iterdir())
    files = [p for p in files if any(reader.recognises(p) for reader in READERS)]
    recordings = read_each(files, machine)
    if not recordings:
        raise DataError(f"{path}: no recording in it. Give a recording, or a folder that holds recordings.")
    mill = config.machine(recordings[0].part.machine)
    each, notes = [], []
    for recording in recordings:
        samples, said = rows_of(recording, mill)
        notes += [f"{recording.part.part}: {note}" for note in said]
        edges = [*(runs(recording) if len(recordings) == 1 else [0]), len(recording)]
        for k, (start, stop) in enumerate(pairwise(edges)):
            inside = samples.take((samples.row >= start) & (samples.row < stop))
            if not len(inside):
                continue
            name = f"{recording.part.part}, run {k + 1}"
            columns = {c: v[start:stop] for c, v in recording.columns.items()}
            columns[TIME] = columns[TIME] - columns[TIME][0]
            info = recording.part.model_copy(update={"part": name})
            own = replace(inside, row=inside.row - start, part=np.full(len(inside), name, dtype=object))
            each.append(Run(Recording(info, columns), own))
    if len(each) < 2:
        raise DataError(f"{path}: {len(each)} run(s) in it; one is left out, so two are needed.")
    return mill, each, notes


def _feeding(each: list[Run], mill: Machine) -> tuple[str, ...]:
    """Linear axes with a current that move in a twentieth of the rows."""
    rows = Samples.concat([r.samples for r in each])
    moves = {a: np.mean(np.abs(rows.inputs[:, k]) > mill.dead_band(a)) for k, a in enumerate(LINEAR_AXES)}
    known = varies(rows.currents)
    return tuple(a for k, a in enumerate(LINEAR_AXES) if known[k] and moves[a] > _FEEDS)


def _splits(each: list[Run], quick: bool) -> Iterator[tuple[str, list[Bool1D], list[Bool1D]]]:
    """Name, and per run which rows train and which test."""
    for out in range(1 if quick else len(each)):
        train = [np.full(len(r.samples), k != out) for k, r in enumerate(each)]
        yield RUN_OUT, train, [~keep for keep in train]
    if quick:
        return
    hidden = [np.isin(sectors(r.samples), _DIAGONAL) for r in each]
    if any(h.any() for h in hidden):
        yield DIAGONALS, [~h for h in hidden], hidden
    late = [np.arange(len(r.samples)) >= 2 * len(r.samples) // 3 for r in each]
    yield LAST_THIRD, [~h for h in late], late


def _hidden(one: Run, keep: Bool1D, axes: tuple[str, ...]) -> Recording:
    """The recording with the currents of `axes` at the rows to learn from, and no others."""
    known = np.zeros(len(one.recording), bool)
    known[one.samples.row[keep]] = True
    columns = {c: v for c, v in one.recording.columns.items() if c not in CURRENT.values()}
    currents = {CURRENT[a]: np.where(known, one.recording[CURRENT[a]], np.nan) for a in axes}
    return Recording(one.recording.part, columns | currents)


def _corrected(model: Mapping[str, object], one: Run, keep: Bool1D) -> Float2D:
    """(n, 4), A: what the equation with all findings says of the rows to be judged; NaN on other axes."""
    series = correct(model, one.recording).corrected
    rows = one.samples.row[keep]
    out = np.full((len(rows), 4), np.nan)
    for i, axis in enumerate(AXES):
        if axis in series:
            out[:, i] = series[axis][rows]
    return out


def _summed_up(table: pd.DataFrame, found: pd.DataFrame, notes: list[str]) -> Outcome:
    grouped: Any = table.groupby(["split", "model", "axis"], sort=False)["square"].mean()  # wider in its annotation
    wide = np.sqrt(grouped).unstack("axis").reset_index()
    axes = [c for c in wide.columns if c not in ("split", "model")]
    asked = [[ASKED.get((split, a), np.nan) for a in axes] for split in wide["split"]]
    wide[[f"{a} asked" for a in axes]] = np.where((wide["model"] == FOUND).to_numpy()[:, None], asked, np.nan)
    words = []
    for split in dict.fromkeys(table["split"]):
        some = wide[wide["split"] == split].set_index("model")
        words.append(
            f"{split}: "
            + ", ".join(f"{a} {some.loc[PRINTED, a]:.3f} -> {some.loc[FOUND, a]:.3f} A" for a in axes)
        )  # fmt: skip
    return Outcome(
        "; ".join(words) + ".",
        (
            Shown("RMSE on rows that no fit had seen", wide, ("A; root mean square over the folds of a split.",)),
            Shown("What was found in each fold", found, ("In order of worth; found on the training rows alone.",)),
        ),
        (
            "The paper has no such table: its equation stays as it is. 'Asked' is what the air cut of a DMC 60H should "
            "reach, from measurements by other means.",
            *notes,
        ),
    )
