"""`make bench`: every line of the speed table, each beside its peer, with accuracy, machine and change since last time.

    python -m benchmarks                      all of them
    python -m benchmarks --quick              small sizes: whether everything runs, and roughly how fast
    python -m benchmarks fits removal         some of them
    python -m benchmarks --markdown table.md  also as a table for a document
    python -m benchmarks growth --rows 1e8    a larger store (19 GB of parts in the temporary folder)

Each module beside this one that has `run()` is a benchmark; it may say smaller sizes as `QUICK` (arguments of `run`).
Every module runs in a process of its own, so that its peak memory is its own and a failure stops nobody else.
"""

from __future__ import annotations

import ast
import importlib
import json
import os
import resource
import subprocess
import sys
from pathlib import Path
from typing import Any

import click

from benchmarks.table import Row, keep, line, load_words, machine, markdown, read_kept

HERE = Path(__file__).parent
ORDER = (
    "fits",
    "generation",
    "removal",
    "reading",
    "motion",
    "diagnosis",
    "iteration",
    "plant",
    "start",
    "models",
    "growth",
)


def modules() -> list[str]:
    """Benchmarks beside this file: those with a function `run`."""
    found = []
    for path in sorted(HERE.glob("*.py")):
        tree = ast.parse(path.read_text(encoding="utf-8"))
        if any(isinstance(node, ast.FunctionDef) and node.name == "run" for node in tree.body):
            found.append(path.stem)
    return sorted(found, key=lambda name: (ORDER.index(name) if name in ORDER else len(ORDER), name))


def child(name: str, quick: bool, most: float | None) -> None:
    """Run one module here; one JSON line per row."""
    module: Any = importlib.import_module(f"benchmarks.{name}")
    sizes = getattr(module, "QUICK", {}) if quick else {}
    if most and hasattr(module, "sized"):
        sizes = {**sizes, **module.sized(most)}
    for found in module.run(**sizes):
        peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20
        about = {"module": name, "load": round(os.getloadavg()[0], 2), "peak_gib": round(peak, 2)}
        print("ROW " + json.dumps({**found, **about}, default=float), flush=True)


def run_one(name: str, quick: bool, most: float | None, before: dict[str, float]) -> list[Row]:
    """The rows of one module, printed as they come. Fails with the module's own last words."""
    command = [sys.executable, "-m", "benchmarks", "--child", name, *(["--quick"] if quick else [])]
    command += ["--rows", str(most)] if most else []
    rows: list[Row] = []
    with subprocess.Popen(
        command, cwd=HERE.parent, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout is not None
        for text in process.stdout:
            if text.startswith("ROW "):
                rows.append(json.loads(text[4:]))
                click.echo(line(rows[-1], before))
        _, fault = process.communicate()
    if process.returncode:
        raise click.ClickException(f"benchmarks.{name} failed:\n{fault[-2000:]}")
    return rows


@click.command(context_settings={"help_option_names": ["-h", "--help"]})
@click.argument("names", nargs=-1)
@click.option("--quick", is_flag=True, help="small sizes")
@click.option("--rows", "most", type=float, help="largest store of the benchmark of growth")
@click.option("--keep", "kept", type=click.Path(path_type=Path), default=Path("out/bench.json"), show_default=True)
@click.option("--markdown", "page", type=click.Path(path_type=Path), help="write the table here as well")
@click.option("--child", "only", hidden=True)
def main(
    names: tuple[str, ...], quick: bool, most: float | None, kept: Path, page: Path | None, only: str | None
) -> None:
    """Speed and accuracy beside named peers.

    \b
    python -m benchmarks --quick
    python -m benchmarks fits removal --markdown table.md
    """
    if only:
        child(only, quick, most)
        return
    known = modules()
    if strangers := sorted(set(names) - set(known)):
        raise click.UsageError(f"no benchmark {', '.join(strangers)}; there are {', '.join(known)}.")
    about, rows, failed = machine(), [], []
    before = read_kept(kept, about, quick)
    click.echo(f"{about['cpu']}, {about['cores']} cores, {about['memory_gib']} GiB; {load_words(os.getloadavg()[0])}")
    click.echo("    ratio  goal              change  work  |  peer  |  error and sizes  |  load")
    for name in names or known:
        try:
            rows += run_one(name, quick, most, before)
        except click.ClickException as fault:
            failed.append(name)
            click.echo(fault.message, err=True)
    keep(kept, about, quick, rows)
    if any("points" in found for found in rows):
        from benchmarks import growth
        from pido.reports.page import write_page

        write_page(growth.page(rows), kept.with_name("growth.html"))
    if page:
        page.write_text(markdown(rows, about), encoding="utf-8")
    if beyond := [found["work"] for found in rows if not found.get("within", True)]:
        raise click.ClickException(f"results changed beyond their bound: {'; '.join(beyond)}")
    if failed:
        raise click.ClickException(f"not measured: {', '.join(failed)}")


if __name__ == "__main__":
    main()
