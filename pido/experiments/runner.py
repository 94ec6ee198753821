"""Runs an experiment: unit by unit, on one core, several, or a Dask cluster; it can be stopped and continued.

In:  name, data, repeats, seed, where to work, a folder.
Out: `units/<digest>.parquet` per unit (whole or not at all), `results.parquet` with the rows of all in the order of the
     plan, `experiment.json`, and the `Outcome`. A folder is of one run.

A unit's file is named by everything that decides its rows: experiment, data, seed, key, values, code. Continuing a run,
or asking for more repeats, computes what is not there yet. The table does not depend on the number of workers.
"""

from __future__ import annotations

import hashlib
import json
import logging
import multiprocessing
import os
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, ProcessPoolExecutor, wait
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from threadpoolctl import threadpool_limits

from pido.core.errors import PidoError, SettingsError
from pido.core.files import replacing
from pido.core.machining import Job
from pido.experiments.base import Experiment, Options, Outcome, Rows, Unit, experiment
from pido.experiments.data import DataError, Fleet, load_fleet
from pido.experiments.places import claim
from pido.workspace import code_version

log = logging.getLogger(__name__)
OnProgress = Callable[[int, int, str], None]
_CORES = "LOKY_MAX_CPU_COUNT"


class ClusterError(PidoError):
    """A cluster that cannot be reached or has lost its workers."""


def _silent(done: int, of: int, what: str) -> None:
    """Progress that nobody watches."""


@dataclass(frozen=True, eq=False)
class Result:
    """The rows of all units, the summary, what was run on, and how many units were there already."""

    experiment: Experiment
    fleet: Fleet
    options: Options
    table: pd.DataFrame
    outcome: Outcome
    units: int
    found: int


def run_experiment(
    name: str,
    data: str | Fleet,
    *,
    folder: Path,
    repeats: int | None = None,
    seed: int = 0,
    workers: int = 1,
    cluster: str | None = None,
    quick: bool = False,
    resume: bool = True,
    machine: str | None = None,
    job: Job | None = None,
    estimators: str = "default",
    percents: Sequence[int] = (),
    delivered: bool = False,
    on_progress: OnProgress = _silent,
) -> Result:
    """Measure all units of an experiment and sum them up.

    data : as `load_fleet` takes it, or a fleet
    repeats : 30 if not given, a few with `quick`
    estimators, percents, delivered : as `Options` says
    workers : processes on this machine; cluster : address of a Dask scheduler, or 'local' for Dask on this machine
    resume : use the units that the folder holds already; without, whatever it holds is replaced
    Raises SettingsError for an unknown experiment or a folder that holds another run, DataError for data that it cannot
    use, ClusterError.
    """
    what = experiment(name)
    repeats = (what.quick_repeats if quick else 30) if repeats is None else repeats
    if repeats < 1 or workers < 1:
        raise SettingsError(f"repeats = {repeats}, workers = {workers}: both must be at least 1.")
    fleet = data if isinstance(data, Fleet) else load_fleet(data, what.family, machine=machine, job=job, seed=seed)
    if any(not 0 < percent <= 100 for percent in percents):
        raise SettingsError(f"percents {', '.join(map(str, percents))}: of a file there are 1 to 100.")
    options = Options(repeats, quick, seed, estimators, tuple(sorted(set(percents))), delivered)
    units = list(what.plan(fleet, options))
    if twice := len(units) - len({unit.key for unit in units}):
        raise SettingsError(f"experiment '{name}' plans {twice} unit(s) twice.")
    facts = {
        "experiment": name, "data": fleet.name, "data_digest": fleet.digest(), "notes": list(fleet.notes), "seed": seed,
        "sets": {k: len(s) for k, s in fleet.sets.items()}, "options": asdict(options), "units": len(units),
        "code": code_version(),
    }  # fmt: skip
    claim(folder, facts, fresh=not resume)
    place, under = folder / "units", _identity(name, fleet, seed)
    place.mkdir(parents=True, exist_ok=True)
    files = {unit.key: place / f"{_digest(under, unit)}.parquet" for unit in units}
    left = [unit for unit in units if not (resume and files[unit.key].exists())]
    found = len(units) - len(left)
    on_progress(found, len(units), f"{found} found" if found else "")
    for done, (unit, rows) in enumerate(_measured(name, fleet, seed, left, workers, cluster), start=found + 1):
        _write(pd.DataFrame(rows), files[unit.key])
        on_progress(done, len(units), unit.key)
    parts = [pd.read_parquet(files[unit.key]) for unit in units]
    if not any(len(part) for part in parts):
        raise DataError(
            f"{fleet.name}: none of the {len(units)} units of '{name}' could be measured: too few rows per set, or no "
            f"current that changes. {' '.join(fleet.notes)}"
        )
    table = pd.concat([part for part in parts if len(part)], ignore_index=True)
    _write(table, folder / "results.parquet")
    return Result(what, fleet, options, table, what.summarise(table), len(units), found)


def measure(name: str, fleet: Fleet, seed: int, unit: Unit) -> Rows:
    """Rows of one unit, on one core: a worker is one, and two that each take all cores wait for one another.

    Of BLAS for another reason too: the last bit of a sum must not depend on how many cores there are.
    """
    key = hashlib.sha256(unit.key.encode()).digest()[:16]
    rng = np.random.default_rng(np.random.SeedSequence([seed, *key]))
    with threadpool_limits(1), _one_core_for_trees():
        return [dict(unit.params) | row for row in experiment(name).measure(fleet, unit.params, rng)]


@contextmanager
def _one_core_for_trees() -> Iterator[None]:
    """What joblib takes for all cores is one; afterwards what it was."""
    before = os.environ.get(_CORES)
    os.environ[_CORES] = "1"
    try:
        yield
    finally:
        if before is None:
            del os.environ[_CORES]
        else:
            os.environ[_CORES] = before


def _measured(
    name: str, fleet: Fleet, seed: int, units: Sequence[Unit], workers: int, cluster: str | None
) -> Iterator[tuple[Unit, Rows]]:
    if cluster is not None and units:
        yield from _on_cluster(name, fleet, seed, units, workers, cluster)
    elif workers > 1 and len(units) > 1:
        yield from _in_processes(name, fleet, seed, units, workers)
    else:
        for unit in units:
            yield unit, measure(name, fleet, seed, unit)


_HELD: dict[str, Any] = {}


def _hold(name: str, fleet: Fleet, seed: int) -> None:
    _HELD.update(name=name, fleet=fleet, seed=seed)
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    """Of a process that was killed the workers wait for ever for their next unit."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


def _measure_held(unit: Unit) -> Rows:
    return measure(_HELD["name"], _HELD["fleet"], _HELD["seed"], unit)


def _in_processes(
    name: str, fleet: Fleet, seed: int, units: Sequence[Unit], workers: int
) -> Iterator[tuple[Unit, Rows]]:
    # spawned, not forked: a forked copy of a threaded process can wait for a lock that nobody holds
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(workers, context, _hold, (name, fleet, seed)) as pool:
        waiting = {pool.submit(_measure_held, unit): unit for unit in units}
        try:
            while waiting:
                for future in wait(waiting, return_when=FIRST_COMPLETED).done:
                    yield waiting.pop(future), future.result()
        finally:
            pool.shutdown(wait=True, cancel_futures=True)


def _on_cluster(
    name: str, fleet: Fleet, seed: int, units: Sequence[Unit], workers: int, address: str
) -> Iterator[tuple[Unit, Rows]]:
    try:
        from dask.distributed import Client, LocalCluster, as_completed
    except ImportError:
        raise ClusterError("Dask is not installed: pip install 'pido[cluster]', or leave --cluster out.") from None
    scheduler = None
    if address == "local":  # None: no dashboard, as Dask's documentation says and its annotation does not
        scheduler = LocalCluster(n_workers=workers, threads_per_worker=1, dashboard_address=None)  # pyright: ignore[reportArgumentType]
    try:
        client = Client(scheduler or address, timeout="15s")
    except (OSError, TimeoutError, ValueError) as error:
        raise ClusterError(f"{address}: no Dask scheduler answers there ({error}). Check the address.") from None
    try:
        held = client.scatter(fleet, broadcast=True)
        waiting = {client.submit(measure, name, held, seed, unit, pure=False): unit for unit in units}
        for future in as_completed(list(waiting)):
            yield waiting[future], future.result()
    finally:
        client.close()
        if scheduler is not None:
            scheduler.close()


def _identity(name: str, fleet: Fleet, seed: int) -> str:
    return f"{name}|{fleet.digest()}|{seed}|{code_version()}|{_code()}"


def _code() -> str:
    """Digest of the experiments' own code."""
    text = hashlib.sha256()
    for path in sorted(Path(__file__).parent.glob("*.py")):
        if path.stem not in ("runner", "paper", "places"):
            text.update(path.read_bytes())
    return text.hexdigest()


def _digest(under: str, unit: Unit) -> str:
    values: Mapping[str, Any] = unit.params
    return hashlib.sha256(f"{under}|{unit.key}|{json.dumps(values, sort_keys=True)}".encode()).hexdigest()[:24]


def _write(table: pd.DataFrame, path: Path) -> None:
    with replacing(path) as temporary:
        table.to_parquet(temporary, index=False)
