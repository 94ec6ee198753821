"""What a plant waits for: from arrival to run, an iteration's overhead, known parts again, a verdict, a rollback.

In:  nothing; small parts of the virtual mill, a Prefect server, a worker and a watcher of its own, MLflow embedded.
Out: rows {work, peer, ratio, goal, error}; ratio is wall seconds (milliseconds where the work says so), medians of
     several, for that is what people wait for. A busy machine adds to them: the CPU seconds of the same calls, which
     it does not, stand beside.
"""

from __future__ import annotations

import csv
import io
import json
import os
import resource
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.table import Row, row
from flows.server import die_with_parent, prefect_server, stop
from pido import plain
from pido.core.recording import Recording
from pido.recordings import read_recording
from pido.recordings.folder import write_folder
from pido.supervision.stream import follow_file
from pido.synthetic.families import impellers
from pido.synthetic.machine import produce
from pido.synthetic.mills import newer_vertical
from pido.tracking import bundle, promotion
from pido.tracking.ledger import Ledger
from pido.workspace import Workspace

QUICK = {"known": 4, "times": 1}
SETTINGS = "compare = false\n[method]\nadaptive = false\ncompare_with_model = false\n"
MACHINE = newer_vertical().machine.id
PIDO = [sys.executable, "-m", "pido.cli"]
PATIENCE_S = 600.0


def run(known: int = 30, times: int = 5, rows: int = 700) -> Iterator[Row]:
    """known : parts of the second pass; times : how often each is measured; rows : samples per part."""
    with tempfile.TemporaryDirectory(prefix="pido-bench-") as temporary:
        root = Path(temporary)
        made = _parts(root / "parts", max(known, times + 1, 4), rows)
        yield _rollback(root, times)
        yield _again(root, made[:known], times)
        yield from _arrivals(root, made[: times + 1])
        yield from _watched(root, made[:4], times)


def _rollback(root: Path, times: int) -> Row:
    place = Workspace.open(root / "rollback")
    for number in (1, 2):
        models = {f"{axis}.skops": f"{axis}{number}".encode() * 100_000 for axis in ("x", "y", "z", "sp")}
        kept = bundle.save(place.bundles, {"machine": MACHINE, "parts": [f"p{number}"]}, models)
        gate = {"passed": True, "words": "no axis is worse"}
        Ledger(place.ledger).finished(f"run{number}", MACHINE, f"p{number}", f"part {number}", kept.digest, gate, {})
    taken = []
    for _ in range(times):
        for version in (1, 2):
            promotion.approve(place, MACHINE, version, by="benchmark", reason="to go back from")
        call = [*PIDO, "rollback", "--by", "benchmark", "--reason", "timed", "--workspace", str(place.root)]
        taken.append(_clocks(call))
    return _command("`pido rollback`, s", taken, "<= 1", "start of Python included")


def _again(root: Path, folders: list[Path], times: int) -> Row:
    """A second pass over parts that all went through an iteration."""
    place = _workspace(root / "again")
    _taken(place, folders)
    before = len(Ledger(place.ledger).iterations(MACHINE))
    taken = [_clocks([*PIDO, "iterate", *map(str, folders), "--workspace", str(place.root)]) for _ in range(times)]
    new = len(Ledger(place.ledger).iterations(MACHINE)) - before
    found = _command(f"`pido iterate` on {len(folders)} known parts, s", taken, "<= 2", f"{new} new runs")
    return found | {"within": new == 0}


def _arrivals(root: Path, parts: list[Path]) -> list[Row]:
    """Through watcher, server and worker; and the same parts by the plain call, in a process that did nothing else."""
    place, plainly = _workspace(root / "served"), _workspace(root / "plain")
    waits, overheads, shares = [], [], []
    with prefect_server(root / "prefect"), _services(place, root):
        from prefect.client.orchestration import get_client

        with get_client(sync_client=True) as client:
            for number, part in enumerate(parts):
                staged = shutil.copytree(part, root / "staging" / part.name)
                start = time.time()
                Path(staged).rename(place.inbox / part.name)
                ended = _finished_run(client, part.name)
                _until(lambda: _nothing_runs(client))  # nor its diagnosis any more
                alone, logging = _plain_seconds(plainly, part)
                if number == 0:
                    continue  # the first one makes MLflow's tables
                waits.append(ended.start_time.timestamp() - start)
                overheads.append(ended.total_run_time.total_seconds() - alone)
                shares.append(logging)
    settle = f"{place.settings.settle_s:g} s of these are waited until files have come to rest"
    return [
        _seconds("from a part's rename to its running flow, s", waits, "<= 5", settle),
        _seconds("an iteration under Prefect beside the plain call, both into MLflow, s more", overheads, "<= 2", ""),
        _seconds("what MLflow takes of an iteration, s", shares, "-", "data sets, figures, report, four models"),
    ]


def _watched(root: Path, parts: list[Path], times: int) -> list[Row]:
    """The verdict on a part's file, and one sample of a stream."""
    place = _workspace(root / "watched")
    _taken(place, parts[:3])
    call = [*PIDO, "monitor", str(parts[3]), "--workspace", str(place.root)]
    _clocks(call)  # residuals of the known parts are kept from here on
    verdicts = [_clocks(call) for _ in range(times)]
    recording = read_recording(parts[3])
    live, taken, ready = root / "live.csv", [], [np.zeros(2)]
    lines = _lines(recording)

    def recorder(seconds: float) -> None:
        """One more sample, as the reader waits for it."""
        taken.append(_now() - ready[0])
        with live.open("a") as out:
            out.write(next(lines, ""))
        ready[0] = _now()

    for _ in follow_file(
        place, live, machine=MACHINE, idle_s=len(recording), sleep=recorder, clock=lambda: float(len(taken))
    ):
        pass
    each = 1e3 * np.array(taken[100 : len(recording)])  # from when the rate is known
    wall, cpu = np.median(each, axis=0)
    about = f"median of {len(each)}; mean {each[:, 0].mean():.2f}; CPU {cpu:.2f}, mean {each[:, 1].mean():.2f}"
    return [
        _command("verdict of `pido monitor` after a part's file, s", verdicts, "<= 5", f"{len(recording)} samples"),
        row("one sample of `pido monitor --follow`, ms", "–", float(wall), "<= 1", about),
    ]


def _lines(recording: Recording) -> Iterator[str]:
    """CSV, line by line."""

    def text(values: list[Any]) -> str:
        out = io.StringIO()
        csv.writer(out, lineterminator="\n").writerow(values)
        return out.getvalue()

    names = list(recording.columns)
    yield text(names)
    for k in range(len(recording)):
        yield text([recording[name][k] for name in names])


def _parts(folder: Path, count: int, rows: int) -> list[Path]:
    """Beginnings of parts of the virtual mill, in production order."""
    mill = newer_vertical()
    found = []
    for course in mill.plan(impellers(mill.machine, count, seed=7)):
        part = produce(mill, [course], seed=len(found), with_simulation=False)[0].recording
        middle = max(0, (len(part) - rows) // 2)
        short = part.rows(slice(middle, middle + rows))
        info = short.part.model_copy(update={"part": f"b{len(found):02d}", "order": len(found) + 1})
        found.append(write_folder(Recording(info, short.columns), folder / info.part))
    return found


def _workspace(root: Path) -> Workspace:
    (root / "inbox").mkdir(parents=True)
    (root / "workspace.toml").write_text(SETTINGS)
    return Workspace.open(root)


@contextmanager
def _services(place: Workspace, root: Path) -> Iterator[None]:
    """A worker and a watcher, ready for the first part."""
    calls = {
        "worker": [sys.executable, "-m", "flows.serve", "--workspace", str(place.root)],
        "watcher": [*PIDO, "watch", str(place.inbox), "--workspace", str(place.root), "--prefect"],
    }
    running = []
    try:
        for name, call in calls.items():
            with (root / f"{name}.log").open("wb") as log:
                running.append(subprocess.Popen(
                    call, env={**os.environ, "PREFECT_RUNNER_POLL_FREQUENCY": "1"}, stdout=log, stderr=log,
                    start_new_session=True, preexec_fn=die_with_parent,
                ))  # fmt: skip
            _until((place.root / f"{name}.alive").exists)
        time.sleep(10.0)  # the worker is alive a little before its deployments are
        yield
    finally:
        for process in reversed(running):
            stop(process)


def _finished_run(client: Any, name: str) -> Any:
    """The run of the part with this name, once it has ended well."""

    def look() -> Any:
        return [r for r in client.read_flow_runs() if r.name == name and r.state.is_final()]

    ended = _until(look)[0]
    if not ended.state.is_completed():
        raise RuntimeError(f"{ended.name}: {ended.state}")
    return ended


def _nothing_runs(client: Any) -> bool:
    """Whether what was to be done by now is done."""
    return all(r.state.is_final() or r.expected_start_time.timestamp() > time.time() for r in client.read_flow_runs())


def _plain_seconds(place: Workspace, part: Path) -> tuple[float, float]:
    """(an iteration, MLflow's part of it) in a fresh process that has imported everything, as a flow's process has."""
    code = (
        "import importlib, sys, time, json; from pathlib import Path; from flows.warm import PRELOAD\n"
        "for name in PRELOAD: importlib.import_module(name)\n"
        "from pido import plain, production; from pido.workspace import Workspace\n"
        "taken, log = [], production.log\n"
        "def timed(root):\n"
        "    start, answer = time.perf_counter(), log(root)\n"
        "    taken.append(time.perf_counter() - start); return answer\n"
        "production.log = timed\n"
        "start = time.perf_counter()\n"
        "answer = plain.run(Workspace.open(sys.argv[1]), [Path(sys.argv[2])], None, lambda *about: None)\n"
        "print(json.dumps([time.perf_counter() - start, sum(taken), len(answer['done'])]))"
    )
    call = [sys.executable, "-c", code, str(place.root), str(part)]
    said = subprocess.run(call, capture_output=True, text=True, check=True).stdout.splitlines()[-1]
    seconds, logging, done = json.loads(said)
    if done != 1:
        raise RuntimeError(f"{part}: the plain call did not take it")
    return float(seconds), float(logging)


def _seconds(work: str, taken: list[float], goal: str, about: str) -> Row:
    """A row for the median of several."""
    each = "median of " + ", ".join(f"{seconds:.2f}" for seconds in taken)
    return row(work, "–", float(np.median(taken)), goal, f"{about}; {each}" if about else each)


def _taken(place: Workspace, folders: list[Path]) -> None:
    """All of them through their iterations."""
    answer = plain.run(place, folders, None, _nobody)
    if len(answer["done"]) != len(folders):
        raise RuntimeError(f"parts were not taken: {answer['rejected']}")


def _nobody(done: int, total: int, what: str) -> None:
    """Nobody watches the progress."""


def _command(work: str, taken: list[np.ndarray], goal: str, about: str) -> Row:
    """A row for the median of several calls of a command."""
    wall, cpu = np.array(taken).T
    return _seconds(work, list(wall), goal, f"{about}; CPU {np.median(cpu):.2f}")


def _clocks(call: list[str]) -> np.ndarray:
    """(wall, CPU) seconds of a command that has to end well."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    start = time.perf_counter()
    done = subprocess.run(call, check=False, capture_output=True, text=True)
    wall = time.perf_counter() - start
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    if done.returncode:
        raise RuntimeError(f"{' '.join(call)}:\n{done.stderr[-2000:]}")
    return np.array([wall, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime])


def _now() -> np.ndarray:
    """(wall, CPU) of this process, s."""
    return np.array([time.perf_counter(), time.process_time()])


def _until(look: Any) -> Any:
    end = time.monotonic() + PATIENCE_S
    while not (found := look()):
        if time.monotonic() > end:
            raise RuntimeError("waited in vain")
        time.sleep(0.1)
    return found
