"""`make demo`: parts arrive one by one, each goes through the flow on a local Prefect server, the gain is shown.

In:  a folder of recordings (`--data`), or nothing: then eight parts of the virtual mill, one of them with something
     concealed in it.
Out: a workspace with store, models and MLflow's runs; a table of what each iteration gained per axis; a diagnosis of
     the part that differs most from its simulation, where parts come with one; how to look.

It ends by itself and leaves no process behind.
"""

from __future__ import annotations

import json
import logging
import os
import shutil
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import click
import numpy as np
from tqdm import tqdm

from flows.server import prefect_server
from pido.core.axes import AXES
from pido.core.errors import PidoError, SettingsError

JOBS = Path(__file__).with_name("jobs")
SOURCES = (".csv", ".json", ".parquet", ".mat")


@click.command()
@click.option("--data", type=click.Path(exists=True, file_okay=False, path_type=Path), help="folder of recordings")
@click.option("--machine", help="machine of recordings that do not name theirs")
@click.option("--job", type=click.Path(exists=True, dir_okay=False, path_type=Path), help="what is cut with what")
@click.option("--parts", "count", default=8, show_default=True, help="parts of the virtual mill, without --data")
@click.option("--seed", type=click.IntRange(min=0), default=0, show_default=True, help="of the virtual mill's parts")
@click.option("--out", type=click.Path(file_okay=False, path_type=Path), default=Path("out/demo"), show_default=True)
def main(data: Path | None, machine: str | None, job: Path | None, count: int, seed: int, out: Path) -> None:
    """Parts through the pipeline, one after another, on a local Prefect server.

    \b
    python -m flows.demo
    python -m flows.demo --data recordings --job jobs/gear.toml
    """
    start = time.perf_counter()
    logging.getLogger("prefect").setLevel(logging.ERROR)
    os.environ.setdefault("PREFECT_LOGGING_LEVEL", "ERROR")
    os.environ["PREFECT_LOGGING_EXTRA_LOGGERS"] = ""
    shutil.rmtree(out, ignore_errors=True)
    with tempfile.TemporaryDirectory(prefix="pido-demo-") as folder:
        sources = _recordings(data) if data else _made_up(Path(folder), count, seed)
        machine, job = machine or _machine_of(sources[0]), job
        workspace = _workspace(out, machine, job, air=data is not None)
        click.echo(f"{len(sources)} part(s) of {machine}; starting a Prefect server", err=True)
        with prefect_server(out.absolute() / "prefect") as api:
            click.echo(f"Prefect's pages while this runs: {api.removesuffix('/api')}", err=True)
            outcomes, rejected = _arrivals(workspace, sources, machine)
        _show(outcomes, rejected)
        odd = _most_different(sources)
        if odd is not None:
            _diagnose(odd, out.absolute() / "diagnosis")
            _unseal(Path(folder))
    _how_to_look(out.absolute(), machine, time.perf_counter() - start)
    if not outcomes:
        raise PidoError("no part could be used; the reasons stand above.")


def _recordings(data: Path) -> list[Path]:
    """What in a folder is a recording: files that a reader knows, part folders; in the order of their names."""
    from pido.arrivals import production_order
    from pido.recordings import recognise

    found = []
    for path in sorted(data.iterdir(), key=production_order):
        if path.is_dir() or path.suffix.lower() in SOURCES:
            try:
                recognise(path)
            except PidoError:
                continue
            found.append(path)
    if not found:
        raise SettingsError(f"{data}: nothing in this folder is a recording that pido knows.")
    return found


def _made_up(folder: Path, count: int, seed: int) -> list[Path]:
    from flows.demo_parts import deliver

    click.echo(
        f"no --data: {count} parts of the virtual mill; one of them holds something its simulation lacks", err=True
    )
    return deliver(folder, count, seed).parts


def _machine_of(path: Path) -> str:
    from pido.recordings import read_recording

    return read_recording(path).part.machine


def _workspace(out: Path, machine: str, job: Path | None, air: bool) -> Path:
    """A fresh workspace; a job that ships with the demo is used where none is given, and what it assumes is said."""
    from pido.workspace import Workspace

    shipped = JOBS / f"{machine}.toml"
    if job is None and shipped.exists():
        job = shipped
        click.echo(shipped.read_text(encoding="utf-8").split("\n\n")[0].replace("# ", ""), err=True)
    if job is None and air:
        click.echo("no job: recordings without process quantities are taken as air cuts (no forces)", err=True)
    Workspace.make(out, job=job, machine=machine, air_cut=True if air else None)
    inbox = out / "inbox"
    inbox.mkdir(parents=True, exist_ok=True)
    return out.absolute()


def _arrivals(workspace: Path, sources: list[Path], machine: str) -> tuple[list[dict[str, Any]], list[str]]:
    """Each part is renamed into the inbox, seen there, and put through the flow."""
    from flows.new_part import new_part
    from pido import production
    from pido.arrivals import Inbox

    inbox = Inbox(workspace / "inbox", settle_s=0.2)
    staging = workspace / "staging"
    outcomes, rejected = [], []
    bar = tqdm(sources, desc="parts", unit="part", file=sys.stderr)
    for source in bar:
        bar.set_postfix_str(source.name)
        staging.mkdir(exist_ok=True)
        copy = staging / source.name
        shutil.copytree(source, copy) if source.is_dir() else shutil.copy2(source, copy)
        copy.rename(workspace / "inbox" / source.name)
        arrived = _wait(inbox)
        state = new_part(str(workspace), str(arrived), machine, return_state=True)
        answer = state.result(raise_on_failure=False)
        if isinstance(answer, PidoError):
            rejected.append(str(answer))
        elif isinstance(answer, BaseException):
            raise answer
        elif isinstance(answer, dict):
            outcomes.append(production.outcome(str(workspace), answer["run_key"]))
        else:  # left for a later look
            rejected.append(state.message or state.name)
    shutil.rmtree(staging, ignore_errors=True)
    return outcomes, rejected


def _wait(inbox: Any) -> Path:
    while True:
        arrived, _ = inbox.look()
        if arrived:
            return arrived[0].path
        time.sleep(0.1)


def _show(outcomes: list[dict[str, Any]], rejected: list[str]) -> None:
    """RMSE on each arriving part by models that had not seen it; gain against real-only and the best trivial rival."""
    for reason in rejected:
        click.echo(f"rejected: {reason}", err=True)
    columns = f"{'real only':>10} {'+PiA +PiE':>10} {'gain':>7}   {'best trivial rival':<28} {'gain':>7}"
    head = f"{'part':<18} {'axis':<4} {columns}"
    click.echo("\nRMSE in A on each arriving part, by models that had not seen it\n" + head)
    for outcome in outcomes:
        name = outcome["part"]["name"][:18]
        if not outcome["metrics"]:
            click.echo(f"{name:<18} first part: nothing was known before it")
        for axis in AXES:
            measured = outcome["metrics"].get(axis)
            if not measured:
                continue
            rivals = {n: m["rmse"] for n, m in measured.items() if n not in ("real", "pia", "pie", "both")}
            best = min(rivals, key=lambda n: rivals[n])
            real, both = measured["real"]["rmse"], measured["both"]["rmse"]
            click.echo(
                f"{name:<18} {axis:<4} {real:>10.4g} {both:>10.4g} {_gain(real, both):>7}   "
                f"{best + f' {rivals[best]:.4g}':<28} {_gain(rivals[best], both):>7}"
            )
    if outcomes:
        click.echo(f"\ngate of version {outcomes[-1]['version']}: {outcomes[-1]['gate']['words']}")


def _most_different(sources: list[Path]) -> Path | None:
    """The part whose recording differs most from its own simulation, beside the other parts on the same axis."""
    from pido.core.columns import CURRENT, CURRENT_SIM
    from pido.recordings import read_recording

    recordings = [read_recording(source) for source in sources]
    if len(sources) < 2 or not all(CURRENT_SIM[axis] in r for r in recordings for axis in AXES):
        return None
    difference = np.array(
        [[np.sqrt(np.nanmean((r[CURRENT[a]] - r[CURRENT_SIM[a]]) ** 2)) for a in AXES] for r in recordings]
    )
    beside_others = difference / np.median(difference, axis=0)
    return sources[int(np.argmax(beside_others.max(axis=1)))]


def _diagnose(part: Path, out: Path) -> None:
    from pido.diagnoses import PAGE, diagnose_into, summary
    from pido.recordings import read_recording

    click.echo(f"\n{part.name} differs most from its simulation. Diagnosis of this part:")
    found = diagnose_into(out, [read_recording(part)])
    for line in summary(found):
        click.echo(f"  {line}")
    click.echo(f"  the page: {out / PAGE}")


def _unseal(folder: Path) -> None:
    """Only now: what was concealed."""
    sealed = folder / "sealed.json"
    if sealed.exists():
        truth = json.loads(sealed.read_text(encoding="utf-8"))
        click.echo(f"  the truth, sealed until here: {truth['part']}, axis {truth['axis']}, {truth['mechanism']}")


def _gain(before: float, after: float) -> str:
    """Reduction of the error; negative where it rose."""
    return f"{100 * (1 - after / before):+.1f} %" if before > 0 else "–"


def _how_to_look(out: Path, machine: str, seconds: float) -> None:
    from pido.tracking.pages import how_to_open
    from pido.workspace import Workspace

    click.echo(f"\n{seconds:.0f} s. Runs, data sets, figures and models: {how_to_open(Workspace.open(out), machine)}")
    click.echo(
        f"Flows and their tasks: PREFECT_HOME={out / 'prefect'} prefect server start   then open http://127.0.0.1:4200"
    )
    click.echo(f"Versions, gate, decisions: pido status --workspace {out}")


if __name__ == "__main__":
    try:
        main()
    except PidoError as fault:
        click.echo(f"demo: {fault}", err=True)
        sys.exit(1)
