"""What a plant waits for: from arrival to run, an iteration's overhead, known parts again, a verdict, a rollback.

In:  nothing; small parts of the virtual mill, a Prefect server, a worker and a watcher of its own, MLflow embedded.
Out: rows {work, peer, ratio, goal, error}; ratio is wall seconds (milliseconds where the work says so), for that is
     what people wait for. A busy machine adds to them.
"""

from __future__ import annotations

import csv
import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.table import Row, row
from flows.server import die_with_parent, prefect_server, stop
from pido.core.recording import Recording
from pido.recordings.folder import write_folder
from pido.synthetic.families import impellers
from pido.synthetic.machine import produce
from pido.synthetic.mills import newer_vertical
from pido.tracking import bundle, promotion
from pido.tracking.ledger import Ledger
from pido.workspace import Workspace

QUICK = {"known": 4, "arrivals": 1, "samples": 300}
SETTINGS = "compare = false\n[method]\nadaptive = false\ncompare_with_model = false\n"
MACHINE = newer_vertical().machine.id
PIDO = [sys.executable, "-m", "pido.cli"]
PATIENCE_S = 600.0


def run(known: int = 30, arrivals: int = 3, samples: int = 2000, rows: int = 700) -> list[Row]:
    """known : parts of the second pass; arrivals : parts through a worker; samples : of a stream; rows : per part."""
    with tempfile.TemporaryDirectory(prefix="pido-bench-") as temporary:
        root = Path(temporary)
        made = _parts(root / "parts", max(arrivals + 2, 4), rows)
        return [_rollback(root), *_again(root, known, rows), *_arrivals(root, made[: arrivals + 1]),
                *_watched(root, made[:4], samples)]  # fmt: skip


def _rollback(root: Path) -> Row:
    place = Workspace.open(root / "rollback")
    for number in (1, 2):
        models = {f"{axis}.skops": f"{axis}{number}".encode() * 100_000 for axis in ("x", "y", "z", "sp")}
        kept = bundle.save(place.bundles, {"machine": MACHINE, "parts": [f"p{number}"]}, models)
        gate = {"passed": True, "words": "no axis is worse"}
        Ledger(place.ledger).finished(f"run{number}", MACHINE, f"p{number}", f"part {number}", kept.digest, gate, {})
    taken = []
    for _ in range(5):
        for version in (1, 2):
            promotion.approve(place, MACHINE, version, by="benchmark", reason="to go back from")
        call = [*PIDO, "rollback", "--by", "benchmark", "--reason", "timed", "--workspace", str(place.root)]
        taken.append(_wall(call))
    return row("`pido rollback`, s", "–", min(taken), "<= 1", f"start of Python included; up to {max(taken):.2f} s")


def _again(root: Path, known: int, rows: int) -> list[Row]:
    """A second pass over parts that all went through an iteration."""
    from pido.plain import run as iterate

    place = _workspace(root / "again")
    folders = _parts(root / "many", known, rows)
    iterate(place, folders, None, lambda done, total, what: None)
    before = len(Ledger(place.ledger).iterations(MACHINE))
    seconds = _wall([*PIDO, "iterate", *map(str, folders), "--workspace", str(place.root)])
    new = len(Ledger(place.ledger).iterations(MACHINE)) - before
    about = f"{new} new runs; {before} before"
    return [row(f"`pido iterate` on {known} known parts, s", "–", seconds, "<= 2", about) | {"within": new == 0}]


def _arrivals(root: Path, parts: list[Path]) -> list[Row]:
    """Through watcher, server and worker; and the same parts by the plain call, in a process that did nothing else."""
    place, plainly = _workspace(root / "served"), _workspace(root / "plain")
    waits, overheads = [], []
    with prefect_server(root / "prefect"), _services(place, root):
        from prefect.client.orchestration import get_client

        with get_client(sync_client=True) as client:
            for number, part in enumerate(parts):
                staged = shutil.copytree(part, root / "staging" / part.name)
                start = time.time()
                Path(staged).rename(place.inbox / part.name)
                ended = _finished_run(client, part.name)
                alone = _plain_seconds(plainly, part)
                if number == 0:
                    continue  # the first one makes MLflow's tables
                waits.append(ended.start_time.timestamp() - start)
                overheads.append(ended.total_run_time.total_seconds() - alone)
    count = f"median of {len(waits)}: " + ", ".join(f"{w:.1f}" for w in waits)
    extra = f"median of {len(overheads)}: " + ", ".join(f"{o:.1f}" for o in overheads)
    settle = f"{place.settings.settle_s:g} s of these are waited until files have come to rest; {count}"
    return [
        row("from a part's rename to its running flow, s", "–", float(np.median(waits)), "<= 5", settle),
        row("an iteration under Prefect with MLflow beside the plain call, s more", "plain call",
            float(np.median(overheads)), "<= 2", extra),
    ]  # fmt: skip


def _watched(root: Path, parts: list[Path], samples: int) -> list[Row]:
    """The verdict on a part's file, and one sample of a stream."""
    from pido.plain import run as iterate
    from pido.recordings import read_recording
    from pido.supervision.stream import follow_file

    place = _workspace(root / "watched")
    iterate(place, parts[:3], None, lambda done, total, what: None)
    call = [*PIDO, "monitor", str(parts[3]), "--workspace", str(place.root)]
    _wall(call)  # residuals of the known parts are kept from here on
    verdict = _wall(call)
    recording = read_recording(parts[3])
    live, taken, ready = root / "live.csv", [], [0.0]
    lines = _lines(recording)

    def recorder(seconds: float) -> None:
        """One more sample, as the reader waits for it."""
        taken.append(time.perf_counter() - ready[0])
        with live.open("a") as out:
            out.write(next(lines, ""))
        ready[0] = time.perf_counter()

    events = follow_file(place, live, machine=MACHINE, idle_s=samples, sleep=recorder, clock=lambda: float(len(taken)))
    for _ in events:
        pass
    each = 1e3 * np.array(taken[100:samples])  # from when the rate is known
    about = f"99 of 100 below {np.percentile(each, 99):.2f} ms, {len(each)} samples"
    return [
        row("verdict of `pido monitor` after a part's file, s", "–", verdict, "<= 5", f"{len(recording)} samples"),
        row("one sample of `pido monitor --follow`, ms", "–", float(np.median(each)), "<= 1", about),
    ]


def _lines(recording: Recording) -> Iterator[str]:
    """CSV, line by line, over and over with time going on."""
    from io import StringIO

    def text(values: list[Any]) -> str:
        out = StringIO()
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
        info = replace(short.part, part=f"b{len(found):02d}", order=len(found))
        found.append(write_folder(replace(short, part=info), folder / info.part))
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
                    call, env={**os.environ, "PREFECT_RUNNER_POLL_FREQUENCY": "2"}, stdout=log, stderr=log,
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
        return [r for r in client.read_flow_runs() if r.name.endswith(f"/{name}") and r.state.is_final()]

    ended = _until(look)[0]
    if not ended.state.is_completed():
        raise RuntimeError(f"{ended.name}: {ended.state}")
    return ended


def _plain_seconds(place: Workspace, part: Path) -> float:
    """The stages alone in a fresh process that has imported everything, as a flow's process has."""
    code = (
        "import sys, time, json; from pathlib import Path\n"
        "from flows import new_part; from pido import plain, production; from pido.workspace import Workspace\n"
        "production.log = lambda root: {'logged': 0, 'fault': ''}\n"
        "start = time.perf_counter()\n"
        "answer = plain.run(Workspace.open(sys.argv[1]), [Path(sys.argv[2])], None, lambda *about: None)\n"
        "print(json.dumps([time.perf_counter() - start, len(answer['done'])]))"
    )
    call = [sys.executable, "-c", code, str(place.root), str(part)]
    seconds, done = json.loads(subprocess.run(call, capture_output=True, text=True, check=True).stdout.splitlines()[-1])
    if done != 1:
        raise RuntimeError(f"{part}: the plain call did not take it")
    return float(seconds)


def _wall(call: list[str]) -> float:
    start = time.perf_counter()
    subprocess.run(call, check=True, capture_output=True)
    return time.perf_counter() - start


def _until(look: Any) -> Any:
    end = time.monotonic() + PATIENCE_S
    while not (found := look()):
        if time.monotonic() > end:
            raise RuntimeError("waited in vain")
        time.sleep(0.1)
    return found
