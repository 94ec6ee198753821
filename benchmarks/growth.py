"""How time and memory grow with the store, with bins, and with workers: `python -m benchmarks growth --rows 1e8`.

In:  nothing; stores of 10^5 rows and more are made in a temporary folder, one Parquet file per part, as production
     keeps them. Out: rows {work, peer, ratio, goal, error}; of a curve, `ratio` is the exponent of time over size and
     `points` the curve itself, which `page` draws.

    rows     one iteration on a grown store when a part arrives: its rows beside those kept, equations, generated rows,
             models; and once the pass over all parts that a fresh machine would need. Peak memory of the process.
             10^8 rows are 19 GB of parts: more than the 4 GiB that it may use.
    bins     local equations from statistics, against bins
    workers  independent machines of a plant on 1, 2, 4 Dask workers, each its own process; then a scheduler and two
             workers that were started by themselves, as on several computers

A store is made once, for its largest size, and used for the smaller ones part by part. Each size runs in a process of
its own: its peak memory is its own.
"""

from __future__ import annotations

import itertools
import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import click
import numpy as np
from bokeh.plotting import figure

from benchmarks.fits import MACHINE, bins_of, samples
from benchmarks.table import Row, row
from pido.core.samples import Samples
from pido.equations.choose import PAPER_CHOICE
from pido.equations.fit import fit_local_from
from pido.equations.moments import Moments
from pido.equations.terms import PAPER
from pido.feature_space.grid import SAMPLING_GRID, Grid
from pido.files.samples import load_samples, save_samples
from pido.iteration import PAPER as PAPER_RECIPE
from pido.iteration import Recipe, balance, retrain
from pido.reports.page import COLOURS, Page, Section, Table, number, write_page
from pido.rows import Rows
from pido.sampling.method import Adaptation, Method
from pido.sampling.shares import ShareRule

QUICK = {"sizes": (20_000, 40_000), "per_part": 5_000, "limit": 10_000, "bins": (50, 100), "workers": (1, 2)}
MEMORY_GIB = 4.0


def part_rows(number: int, n: int) -> Samples:
    """Rows of a part that goes where parts go: a few feeds and directions, arcs between them, several depths."""
    rng = np.random.default_rng(number)
    made = samples(n, seed=number)
    feed = rng.choice([4.0, 6.0, 8.0, 9.6, 12.0], n) + rng.normal(0, 0.05, n)
    angle = np.where(rng.random(n) < 0.7, rng.integers(0, 4, n) * np.pi / 2, rng.uniform(0, 2 * np.pi, n))
    inputs = made.inputs.copy()
    inputs[:, 0], inputs[:, 1] = feed * np.cos(angle), feed * np.sin(angle)
    ar = rng.choice([8.0, 20.0, 45.0], n) + rng.normal(0, 1.0, n)
    return replace(made, inputs=inputs, ar=ar, part=np.full(n, f"part-{number:06d}", dtype=object))


def run(
    sizes: Sequence[int] = (100_000, 1_000_000, 4_000_000),
    per_part: int = 100_000,
    limit: int = 300_000,
    bins: Sequence[int] = (500, 1000, 2000, 4000, 8000),
    workers: Sequence[int] = (1, 2, 4),
    folder: Path | None = None,
) -> Iterator[Row]:
    """Every curve."""
    with tempfile.TemporaryDirectory() as made:
        yield from _against_rows(Path(folder or made), sizes, per_part, limit)
    yield from _against_bins(bins)
    yield from _against_workers(workers)


def _against_rows(folder: Path, sizes: Sequence[int], per_part: int, limit: int) -> Iterator[Row]:
    for k in range(max(sizes) // per_part + 1):
        place = folder / f"part-{k:06d}.parquet"
        if not place.exists():
            save_samples(part_rows(k, per_part), place)
    found = []
    for size in sizes:
        command = [sys.executable, "-m", "benchmarks.growth", "--one", str(folder), str(size // per_part), str(limit)]
        output = subprocess.run(command, check=True, capture_output=True, text=True, cwd=Path(__file__).parents[1])
        told = json.loads(output.stdout)
        found.append(told)
        yield row(
            f"a part arrives at a store of {size:.0e} rows ({limit} kept)",
            "memory, GiB",
            told["peak_gib"],
            f"<= {MEMORY_GIB:g}",
            f"CPU: rows {told['new_part']:.2f} s, equations and balance {told['balance']:.1f} s, models "
            f"{told['train']:.1f} s; all parts read afresh {told['all_parts']:.1f} s",
        )
    above = [(s, f) for s, f in zip(sizes, found, strict=True) if s > limit]
    if len(above) > 1:
        for what, words, goal in (
            ("iteration", "an iteration", "<= 0.2"),
            ("all_parts", "reading all parts afresh", "<= 1.1"),
            ("peak_gib", "peak memory (GiB)", "<= 0.2"),
        ):
            slope = exponent([s for s, _ in above], [f[what] for _, f in above])
            points = [list(sizes), [f[what] for f in found]]
            yield row(
                f"exponent of {words} over rows in the store", f"{len(above)} sizes above the limit", slope, goal, "–"
            ) | {"points": points}


def one(folder: Path, parts: int, limit: int) -> dict[str, float]:
    """One size: CPU seconds of each stage, peak memory."""
    names = [f"part-{number:06d}" for number in range(parts + 1)]
    with tempfile.TemporaryDirectory() as derived:
        rows = Rows(Path(derived), "growth", SAMPLING_GRID, lambda name: load_samples(folder / f"{name}.parquet"))
        start = time.process_time()
        rows.of(names[:-1], limit)
        all_parts = time.process_time() - start
        start = time.process_time()
        real = rows.of(names, limit)
        new_part = time.process_time() - start
    # an arrival between two adaptive choices: those are made when the data have grown by half, on fewer rows
    recipe = Recipe(Method(share=ShareRule(density=40.0), adaptive=False), inputs=PAPER_RECIPE.inputs)
    path = part_rows(parts, 5_000)
    adaptation = Adaptation(PAPER_CHOICE, None, (recipe.method.share,) * 4, {}, len(real))
    start = time.process_time()
    balanced = balance(real, path, adaptation, MACHINE, recipe, 0)
    balancing = time.process_time() - start
    start = time.process_time()
    retrain(real, balanced.generated, balanced.weights, "both", recipe, 0)
    training = time.process_time() - start
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20
    return {"all_parts": all_parts, "new_part": new_part, "balance": balancing, "train": training, "peak_gib": peak,
            "iteration": new_part + balancing + training, "kept": len(real)}  # fmt: skip


def _against_bins(bins: Sequence[int]) -> Iterator[Row]:
    moments = Moments(PAPER, MACHINE, Grid((1.0, 1.0, 10.0)))
    moments.add(samples(200_000))
    seconds = []
    for count in bins:
        wanted = bins_of(count)
        fit_local_from(moments, wanted[:10])
        start = time.process_time()
        fit_local_from(moments, wanted)
        seconds.append(time.process_time() - start)
    yield row(
        f"exponent of fits over bins, {bins[0]} to {bins[-1]}",
        "CPU time",
        exponent(bins, seconds),
        "<= 1.1",
        ", ".join(f"{b}: {s:.2f} s" for b, s in zip(bins, seconds, strict=True)),
    ) | {"points": [list(bins), seconds]}


def machine_of_a_plant(seed: int) -> float:
    """Work of one machine's iteration, for the curve over workers: balance and train on 5 000 rows."""
    real, path = part_rows(seed, 5_000), part_rows(seed + 1000, 500)
    recipe = Recipe(Method(adaptive=False))
    adaptation = Adaptation(PAPER_CHOICE, None, (recipe.method.share,) * 4, {}, len(real))
    made = balance(real, path, adaptation, MACHINE, recipe, seed)
    models = retrain(real, made.generated, made.weights, "both", recipe, seed)
    return float(np.nanmean(models.predict(path)))


def _against_workers(workers: Sequence[int]) -> Iterator[Row]:
    """Eight machines' iterations, on workers beside a scheduler; then all of them started by themselves."""
    from distributed import Client, LocalCluster

    first = None
    for count in workers:
        with (
            LocalCluster(n_workers=count, threads_per_worker=1, processes=True, dashboard_address=None) as cluster,
            Client(cluster) as client,
        ):
            seconds = _eight_machines(client, count)
        first = first or seconds
        yield _workers_row(f"8 machines on {count} Dask worker(s)", count, first, seconds)
    if len(workers) > 1 and first:
        with _separate_cluster(2) as scheduler, Client(scheduler_file=str(scheduler)) as client:
            client.wait_for_workers(2, timeout=120)
            seconds = _eight_machines(client, 2)
        yield _workers_row("8 machines on a scheduler and 2 workers as their own processes", 2, first, seconds)


def _eight_machines(client: Any, workers: int) -> float:
    client.gather(client.map(machine_of_a_plant, range(workers), pure=False))  # compiled and imported
    start = time.perf_counter()
    client.gather(client.map(machine_of_a_plant, range(8), pure=False))
    return time.perf_counter() - start


def _workers_row(work: str, count: int, first: float, seconds: float) -> Row:
    possible = min(count, os.cpu_count() or 1)
    goal = f">= {0.7 * possible:g}" if count > 1 else "–"
    told = row(work, f"1 worker; {possible} core(s) to share", first / seconds, goal, f"{seconds:.1f} s")
    return told | {"points": [[count], [seconds]]}


@contextmanager
def _separate_cluster(workers: int) -> Iterator[Path]:
    """A scheduler and workers, each started by its own command; yields the file that says where the scheduler is."""
    with tempfile.TemporaryDirectory() as folder, ExitStack() as stack:
        where = Path(folder) / "scheduler.json"
        dask = [sys.executable, "-m", "dask"]
        commands = [[*dask, "scheduler", "--port", "0", "--no-dashboard", "--scheduler-file", str(where)]]
        commands += [
            [*dask, "worker", "--scheduler-file", str(where), "--nthreads", "1", "--no-dashboard",
             "--local-directory", folder]
        ] * workers  # fmt: skip
        for command in commands:
            process = stack.enter_context(
                subprocess.Popen(
                    command, cwd=Path(__file__).parents[1], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
                )
            )
            stack.callback(process.terminate)
        yield where


def page(rows: Sequence[Row]) -> Page:
    """The curves that `rows` hold, both axes logarithmic, each with its exponent or ratio."""
    curves = {"rows in the store": [], "bins": [], "Dask workers": []}
    for found in rows:
        if "points" in found:
            kind = "Dask workers" if "machines" in found["work"] else "bins" if "bins" in found["work"] else None
            curves[kind or "rows in the store"].append(found)
    sections = []
    for kind, members in curves.items():
        if not members:
            continue
        plot = figure(
            title=f"against {kind}", x_axis_label=kind, y_axis_label="s (GiB for memory)", height=320,
            sizing_mode="stretch_width", x_axis_type="log", y_axis_type="log",
        )  # fmt: skip
        for found, colour in zip(members, itertools.cycle(COLOURS.values())):
            x, y = found["points"]
            plot.scatter(x, y, size=8, color=colour, legend_label=found["work"])
            plot.line(x, y, color=colour, legend_label=found["work"])
        head = ("curve", "exponent, or gain over one worker", "points")
        body = [
            (m["work"], number(m["ratio"]), ", ".join(f"{x:g}: {y:.3g}" for x, y in zip(*m["points"], strict=True)))
            for m in members
        ]
        sections.append(Section(f"Against {kind}", table=Table(head, body), figures=[plot]))
    steep = [m for m in rows if m["work"].startswith("exponent of an iteration")]
    verdict = "Time and memory of an iteration beside what it grows with."
    if steep:
        verdict = f"An iteration's time grows with the {steep[0]['ratio']:.2f}th power of the rows in the store."
    return Page("How it grows", verdict, sections)


def sized(rows: float) -> dict[str, Any]:
    """Arguments of `run` for stores of up to `rows` rows."""
    return {"sizes": [int(10**k) for k in np.arange(5, np.log10(rows) + 1e-9)]}


def exponent(sizes: Sequence[float], seconds: Sequence[float]) -> float:
    """Slope of time over size, both logarithmic."""
    return float(np.polyfit(np.log(sizes), np.log(np.maximum(seconds, 1e-9)), 1)[0])


@click.command()
@click.option("--most", type=float, default=4e6, show_default=True, help="largest store, rows")
@click.option("--limit", type=int, default=300_000, show_default=True, help="rows that models learn from")
@click.option("--folder", type=click.Path(path_type=Path), help="keep the parts here, for the next run")
@click.option("--one", "single", nargs=3, type=str, hidden=True)
def main(most: float, limit: int, folder: Path | None, single: tuple[str, str, str] | None) -> None:
    """Curves of time and memory.

    \b
    python -m benchmarks.growth --most 1e8 --folder out/growth
    """
    if single:
        click.echo(json.dumps(one(Path(single[0]), int(single[1]), int(single[2]))))
        return
    sizes = sized(most)["sizes"]
    if folder:
        folder.mkdir(parents=True, exist_ok=True)
    found: list[dict[str, Any]] = []
    for line in run(sizes, limit=limit, folder=folder):
        found.append(line)
        click.echo(f"{line['ratio']:>8.3g}  {line['goal']:<8} {line['work']} | {line['peer']} | {line['error']}")
    write_page(page(found), Path("out/growth.html"))


if __name__ == "__main__":
    main()
