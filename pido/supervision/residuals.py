"""Residuals of parts on which the model had not been trained: what a band is learnt from.

In:  a workspace and a version of the models. Out: PartResiduals of every part that went through an iteration.

Of a part that the version was trained on, they are what stood when the part came: each iteration says what it expects
of the arriving part before it learns from it, and those predictions are kept with the run. Nothing was known before the
first part, so its rows are predicted in stretches, each by models of the others. A part that the version has not learnt
from is predicted by the version itself. What was found is kept in `derived/`, under the key of run or version.

Inputs are of the kind that the version's models take, whatever the settings ask for by now.
"""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow.parquet as pq

from pido.core.arrays import Array1D, Float1D, Float2D, Int1D
from pido.core.axes import AXES
from pido.core.columns import TIME
from pido.core.files import replacing
from pido.core.machining import Machine
from pido.core.recording import Recording
from pido.core.samples import Samples
from pido.core.spindle_tool import tool_in_spindle
from pido.feature_space.regional import folds
from pido.iteration import Recipe
from pido.models.axis_models import AxisModels
from pido.models.inputs import NAMES, InputKind, model_inputs
from pido.monitoring.band import MOST_PARTS
from pido.monitoring.doubt import Support
from pido.monitoring.residuals import WINDOW_S, PartResiduals
from pido.monitoring.standing import explained, other_end
from pido.parts import at_rate, lost_of, machine_of, recipe_of, samples_of
from pido.rows import training_rows
from pido.store import Store
from pido.tracking import promotion, report_files
from pido.tracking.bundle import Bundle
from pido.tracking.ledger import Iteration, Ledger
from pido.workspace import Workspace

log = logging.getLogger(__name__)
_INPUT, _DUE = "input_", "due"
STRETCHES = 6
FEW = 4


@dataclass(frozen=True, eq=False)
class Said:
    """What models say of rows: currents (n, 4), A, and the other end of what a standing axis' friction allows."""

    currents: Float2D
    other_end: Float2D

    @classmethod
    def by(cls, models: AxisModels, inputs: Float2D, machine: Machine) -> Said:
        """inputs : (n, d) – of the kind that the models take"""
        return cls(models.predict_inputs(inputs), other_end(models.by_axis, inputs, machine))

    @classmethod
    def nothing(cls, rows: int) -> Said:
        """NaN everywhere."""
        return cls(np.full((rows, len(AXES)), np.nan), np.full((rows, len(AXES)), np.nan))


def known_residuals(
    workspace: Workspace, machine: str, version: Bundle, models: AxisModels, without: str = ""
) -> list[PartResiduals]:
    """Held-out residuals of the machine's parts in production order, as this version makes them; `part` is the digest.

    version, models : what is to judge; limits learnt from what better or worse models said would not be its own
    without : digest of a part to leave out, because it is the one to be judged
    Up to FEW parts that the version was trained on are predicted anew, each by models of all others: what was said of
    them when they came was said by models of one or two parts, and would make the band far too wide for this version.
    Of more parts, those count whose models had seen at least half as many parts as this version. A part whose run files
    are gone is left out, and the log says so. Parts that are new to the version, the last MOST_PARTS of them, are
    predicted by its own models.
    A part that is withdrawn is none of them. What was said of a part by models that had learnt from one does not count:
    the last FEW of those are predicted anew.
    """
    last, clean = _newest(workspace, machine)
    order = [e.digest for e in Store(workspace.store).entries(machine) if e.digest in last and e.digest != without]
    seen = set(Store(workspace.store).today(version.content["parts"]).values())
    learnt = [digest for digest in order if digest in seen]
    new = [digest for digest in order if digest not in seen][-MOST_PARTS:]
    recipe = replace(recipe_of(workspace), inputs=models.inputs)
    if 1 < len(learnt) <= FEW:
        found = _each_by_the_others(workspace, machine, learnt, learnt, recipe)
    else:
        later = learnt[len(learnt) // 2 if len(learnt) > FEW else 0 :]
        found = [one for digest in later if digest in clean and (one := _kept(workspace, clean[digest], recipe))]
        spoilt = [digest for digest in later if digest not in clean][-FEW:] if len(learnt) > 1 else []
        found += _each_by_the_others(workspace, machine, spoilt, learnt, recipe)
    found += _by_itself(workspace, machine, version, models, new)
    return sorted(found, key=lambda one: order.index(one.part))


def held_out(workspace: Workspace, machine: str, digest: str, inputs: InputKind) -> PartResiduals | None:
    """The residuals of one known part by models that had not seen it, or None; with the inputs that a version takes."""
    last, clean = _newest(workspace, machine)
    recipe = replace(recipe_of(workspace), inputs=inputs)
    if digest in clean:
        return _kept(workspace, clean[digest], recipe)
    order = [e.digest for e in Store(workspace.store).entries(machine) if e.digest in last]
    if digest not in order or len(order) == 1:
        return None
    return _each_by_the_others(workspace, machine, [digest], order, recipe)[0]


def _newest(workspace: Workspace, machine: str) -> tuple[dict[str, Iteration], dict[str, Iteration]]:
    """By part, its newest iteration, and its newest whose models had learnt from no part that is withdrawn."""
    done = Ledger(workspace.ledger).iterations(machine)
    spoilt = promotion.trained_on_withdrawn(workspace, machine)
    return {i.part: i for i in done}, {i.part: i for i in done if i.version not in spoilt}


def support(workspace: Workspace, digests: Sequence[str], inputs: InputKind) -> Support:
    """Distances from the rows of these parts, in the inputs that the models take."""
    return Support(np.vstack([model_inputs(samples_of(workspace, d), inputs) for d in digests]))


def on_the_clock(
    part: str,
    recording: Recording,
    samples: Samples,
    inputs: Float2D,
    said: Said,
    doubt: Float1D,
    lost: Int1D | None = None,
) -> tuple[PartResiduals, Int1D]:
    """Residuals at even times, and where on them each row lies (n,).

    recording : at the method's rate, as the rows are numbered; a pause in it keeps at least a window's length, so that
        no window reaches across it
    lost : (m,), samples of which no row could be made for want of a value, numbered as rows are
    """
    time = recording.time
    step = float(np.median(np.diff(time)))
    longest = max(2, int(np.ceil(WINDOW_S / step)) + 1)
    steps = np.clip(np.rint(np.diff(time) / step).astype(np.int64), 1, longest)
    place = np.concatenate([[0], np.cumsum(steps)])
    n = int(place[-1]) + 1
    clock = np.interp(np.arange(n), place, time)
    row = np.searchsorted(place, np.arange(n), side="right") - 1
    rows = place[samples.row]
    residual, expected, away = np.full((n, len(AXES)), np.nan), np.full((n, len(AXES)), np.nan), np.full(n, np.nan)
    given = np.full((n, inputs.shape[1]), np.nan)
    nearest = explained(said.currents, said.other_end, samples.currents)
    residual[rows], expected[rows], away[rows], given[rows] = samples.currents - nearest, nearest, doubt, inputs
    due = np.zeros(n, bool)
    due[rows] = True
    if lost is not None:
        due[place[lost]] = True
    tool, block = _tool(recording)[row], _block(recording)[row]
    program = recording.part.program or ""
    return PartResiduals(part, clock, residual, expected, tool, block, away, given, program, due), rows


def _by_itself(
    workspace: Workspace, machine: str, version: Bundle, models: AxisModels, digests: Sequence[str]
) -> list[PartResiduals]:
    """Of parts that the version was not trained on."""
    paths = {
        digest: workspace.derived
        / f"held-out-{version.digest[:24]}-{workspace.run_key(machine, [digest])[:24]}.parquet"
        for digest in digests
    }
    missing = [digest for digest, path in paths.items() if not _is_kept(path, models.inputs)]
    if missing:
        near = support(workspace, version.content["parts"], models.inputs)
        for digest in missing:
            samples = samples_of(workspace, digest)
            inputs = model_inputs(samples, models.inputs)
            said = Said.by(models, inputs, machine_of(workspace, machine))
            recording = at_rate(workspace, _bare(Store(workspace.store).load(digest)))
            lost = lost_of(workspace, digest)
            made = on_the_clock(digest, recording, samples, inputs, said, near.distance(inputs), lost)[0]
            _save(made, paths[digest])
    return [_load(digest, path) for digest, path in paths.items()]


def _each_by_the_others(
    workspace: Workspace, machine: str, wanted: Sequence[str], order: Sequence[str], recipe: Recipe
) -> list[PartResiduals]:
    """Of each of the parts `wanted`, by models of all others of `order`."""
    key = workspace.run_key(machine, list(order))[:24]
    paths = {digest: workspace.derived / f"held-out-{key}-{digest[:12]}.parquet" for digest in wanted}
    if not all(_is_kept(path, recipe.inputs) for path in paths.values()):
        limit, seed = workspace.settings.method.rows_max, workspace.settings.seed
        for digest in wanted:
            others = [d for d in order if d != digest]
            samples, rest = samples_of(workspace, digest), training_rows(workspace, machine, others, limit)
            mine = model_inputs(samples, recipe.inputs)
            models = AxisModels.fit(rest, choice=recipe.estimators, inputs=recipe.inputs, seed=seed)
            doubt = support(workspace, others, recipe.inputs).distance(mine)
            recording = at_rate(workspace, _bare(Store(workspace.store).load(digest)))
            said = Said.by(models, mine, machine_of(workspace, machine))
            lost = lost_of(workspace, digest)
            _save(on_the_clock(digest, recording, samples, mine, said, doubt, lost)[0], paths[digest])
    return [_load(digest, path) for digest, path in paths.items()]


def _kept(workspace: Workspace, iteration: Iteration, recipe: Recipe) -> PartResiduals | None:
    path = workspace.derived / f"held-out-{iteration.run_key[:24]}.parquet"
    if not _is_kept(path, recipe.inputs):
        made = _make(workspace, iteration, recipe)
        if made is None:
            return None
        _save(made, path)
    return _load(iteration.part, path)


def _make(workspace: Workspace, iteration: Iteration, recipe: Recipe) -> PartResiduals | None:
    digest = iteration.part
    folder = workspace.runs / iteration.run_key
    if not folder.exists():
        log.warning("%s: the files of its iteration are gone; the band does without it", digest[:12])
        return None
    files = report_files.load(workspace.runs, iteration.run_key)
    samples = samples_of(workspace, digest)
    columns = model_inputs(samples, recipe.inputs)
    before = [d for d in files.summary["parts"] if d != digest]
    if before and len(files.trace) == len(samples) and f"both_{AXES[0]}" in files.trace:
        said = Said(_of(files.trace, "both"), _of(files.trace, report_files.OTHER_END))
        doubt = support(workspace, before, recipe.inputs).distance(columns)
    elif before:
        log.warning("%s: what was expected of it was kept for other rows; the band does without it", digest[:12])
        return None
    else:
        said, doubt = in_stretches(samples, recipe, workspace.settings.seed, machine_of(workspace, iteration.machine))
    stored = Store(workspace.store).load(digest)
    lost = lost_of(workspace, digest)
    return on_the_clock(digest, at_rate(workspace, _bare(stored)), samples, columns, said, doubt, lost)[0]


def in_stretches(samples: Samples, recipe: Recipe, seed: int, machine: Machine) -> tuple[Said, Float1D]:
    """What is said of each stretch, and its distances (n,), as models of the others see it."""
    fold = folds(samples, STRETCHES)
    columns = model_inputs(samples, recipe.inputs)
    said, doubt = Said.nothing(len(samples)), np.full(len(samples), np.nan)
    for k in np.unique(fold):
        out = fold == k
        if out.all():
            continue
        rest = AxisModels.fit(samples.take(~out), choice=recipe.estimators, inputs=recipe.inputs, seed=seed)
        stretch = Said.by(rest, columns[out], machine)
        said.currents[out], said.other_end[out] = stretch.currents, stretch.other_end
        doubt[out] = Support(columns[~out]).distance(columns[out])
    return said, doubt


def _of(trace: pd.DataFrame, name: str) -> Float2D:
    """NaN where an iteration of an earlier release did not keep it."""
    return trace.reindex(columns=[f"{name}_{axis}" for axis in AXES]).to_numpy(float)


def _bare(recording: Recording) -> Recording:
    """Only what says when, with which tool and in which block."""
    return Recording(recording.part, {n: v for n, v in recording.columns.items() if n in (TIME, "tool_id", "nc_line")})


def _tool(recording: Recording) -> Array1D:
    tool = tool_in_spindle(recording)
    return np.full(len(recording), "", object) if tool is None else tool


def _block(recording: Recording) -> Int1D:
    if "nc_line" not in recording:
        return np.full(len(recording), -1, np.int64)
    line = np.asarray(recording["nc_line"], float)
    return np.where(np.isfinite(line), line, -1).astype(np.int64)


def _is_kept(path: Path, inputs: InputKind) -> bool:
    """Whether residuals lie at `path`, with all that is kept of them and the inputs that models of this kind take."""
    if not path.exists():
        return False
    names = pq.read_schema(path).names
    return _DUE in names and sum(n.startswith(_INPUT) for n in names) == len(NAMES[inputs])


def _save(part: PartResiduals, path: Path) -> None:
    columns: dict[str, Array1D] = {"time": part.time, "tool": part.tool.astype(str), "block": part.block}
    columns |= {f"residual_{axis}": part.residual[:, i] for i, axis in enumerate(AXES)}
    columns |= {f"predicted_{axis}": part.predicted[:, i] for i, axis in enumerate(AXES)}
    columns |= {_DUE: np.asarray(np.isfinite(part.residual).any(axis=1) if part.due is None else part.due)}
    columns |= {"doubt": np.zeros(len(part.time)) if part.doubt is None else part.doubt}
    if part.inputs is not None:
        columns |= {f"{_INPUT}{k}": values for k, values in enumerate(part.inputs.T)}
    table = pd.DataFrame(columns)
    table.attrs = {"program": part.program}
    with replacing(path) as temporary:
        table.to_parquet(temporary, index=False)


def _load(part: str, path: Path) -> PartResiduals:
    table = pd.read_parquet(path)
    residual, predicted = (
        np.ascontiguousarray(table[[f"{kind}_{axis}" for axis in AXES]].to_numpy(float))
        for kind in ("residual", "predicted")
    )
    tool, block, doubt = (
        table["tool"].to_numpy(object),
        table["block"].to_numpy(np.int64),
        table["doubt"].to_numpy(float),
    )
    given = [name for name in table.columns if name.startswith(_INPUT)]
    return PartResiduals(
        part, table["time"].to_numpy(float), residual, predicted, tool, block, doubt,
        np.ascontiguousarray(table[given].to_numpy(float)), table.attrs["program"], table[_DUE].to_numpy(bool),
    )  # fmt: skip
