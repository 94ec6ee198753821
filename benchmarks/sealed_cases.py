"""An examination on sealed cases: draw, seal, ask `pido` blind, open the truth, print what came of it.

In:  a `Generator` of cases: what it plans, and how it writes one task as part folders with the truth apart from them.
Out: its command. Each generator is a package beside this module with its own machines and formulas; what a task, an
effect and a truth are, and how an answer is asked for and judged, is the same for all of them.

Rows are kept per case under a digest of all code that decides them: a run that was stopped goes on where it was.
"""

# pandas annotates a column as an array, and a selection of rows as a table or a column
# pyright: reportAttributeAccessIssue=false, reportArgumentType=false, reportReturnType=false

from __future__ import annotations

import hashlib
import json
import shutil
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import click
import pandas as pd

from benchmarks.sealed_truth import Task
from pido.core.errors import PidoError
from pido.experiments.concealed import code_digest, each_once, in_a_process, rates, tool
from pido.experiments.judged import judge

ROOT = Path(__file__).parents[1]

GROUPS: Mapping[str, str] = {
    "single": "single", "pair": "pair", "wrong": "wrong coefficient", "fault": "data fault",
    "box": "confined to a region", "outside": "outside the vocabulary", "confounded": "confounded", "clean": "clean",
}  # fmt: skip
"""What a group is called on the command line, and in a plan."""


Plan = Callable[[int, int], Sequence[Task]]
"""(how many cases, seed) -> tasks."""


@dataclass(frozen=True)
class Generator:
    """package : dotted name, run with -m; about : of its machines; what follows "Examine ... on"

    plan : of its first edition, later : of those after it; write : (task, folder, sealed folder) -> part folders, the
    unseen one last
    """

    package: str
    about: str
    plan: Plan
    write: Callable[[Task, Path, Path], Sequence[Path]]
    later: tuple[Plan, ...] = ()

    @property
    def name(self) -> str:
        return self.package.rpartition(".")[2]


def solve(generator: Generator, task: Task, folder: Path) -> dict[str, Any]:
    """Draw, seal, ask, open: one row. An answer that did not come is a row with its error."""
    work, sealed = folder / "work" / task.key, folder / "sealed" / task.key
    for place in (work, sealed):
        shutil.rmtree(place, ignore_errors=True)
    parts = generator.write(task, work, sealed)
    about = {"case": task.key, "error": "", "group": task.group, "strength": task.strength, "seed": task.seed}
    try:
        answer = tool(parts[:-1], parts[-1], work)
    except PidoError as error:
        return {**about, "error": str(error)[-500:]}
    truth = json.loads((sealed / "truth.json").read_text(encoding="utf-8"))
    row = judge(answer, truth, sealed, parts[-1].name)
    for place in (work, sealed):
        shutil.rmtree(place)
    return {**about, "plant": truth["machine"], **row}


def chosen(tasks: Sequence[Task], first: int, last: int | None, groups: Sequence[str]) -> dict[int, Task]:
    """Cases first to last of a plan that are of one of the groups, if any are named, by their number in the plan."""
    named = {GROUPS[g] for g in groups}
    numbered = list(enumerate(tasks))[first:last]
    return {k: task for k, task in numbered if not named or task.group in named}


def examine(generator: Generator, tasks: Sequence[Task], folder: Path, workers: int) -> pd.DataFrame:
    """One row per case; what `folder` holds from an earlier run of the same code is not asked again."""
    kept, under = folder / "rows", digest(generator)
    kept.mkdir(parents=True, exist_ok=True)
    files = {t: kept / f"{t.key}-{under}.json" for t in tasks}

    def ask(task: Task) -> dict[str, Any]:
        about, said = f"{task.group}, case {task.key}", json.dumps(asdict(task))
        return in_a_process(about, generator.package, "--one", said, "--out", str(folder), place=ROOT)

    def tell(done: int, of: int, task: Task | None) -> None:
        if task is not None:
            click.echo(f"{done} of {of}: {task.group}", err=True)

    table = pd.DataFrame(each_once(files, ask, workers, tell))
    table.to_parquet(folder / "cases.parquet", index=False)
    return table


def digest(generator: Generator) -> str:
    """Of the tool, of how it is judged, of what all generators share, and of everything of this generator."""
    text = hashlib.sha256(code_digest().encode())
    here = Path(__file__)
    shared = [here, here.with_name("sealed_truth.py")]
    for path in [*shared, *sorted(ROOT.joinpath(*generator.package.split(".")).rglob("*.py"))]:
        text.update(path.read_bytes())
    return text.hexdigest()[:10]


def tables(rows: pd.DataFrame) -> Mapping[str, pd.DataFrame]:
    """By group, singles by strength, and where the tool was wrong."""
    good = rows[rows["error"] == ""].copy()
    for name in ("auc", "removed"):
        good[name] = pd.to_numeric(good.get(name, pd.Series(float("nan"), good.index)))
    single = good[good["group"] == "single"]
    wrong = good[good["first"].isin([False]) | (good["false"] > 0)]
    return {
        "By group": pd.DataFrame([{"group": g, **rates(of)} for g, of in good.groupby("group")]),
        "Single effects by strength": pd.DataFrame(
            [{"strength": s, **rates(of)} for s, of in single.groupby("strength")]
        ),
        "Where it was wrong": wrong[["case", "group", "strength", "plant", "truth", "said"]],
        "Without an answer": rows.loc[rows["error"] != "", ["case", "group", "error"]],
    }


def only_draw(generator: Generator, tasks: Mapping[int, Task], folder: Path) -> None:
    """`case_000`, ... with the part folders, the last one unseen; the truth of each in `truth/case_000`."""
    for k, task in tasks.items():
        name = f"case_{k:03d}"
        for place in (folder / name, folder / "truth" / name):
            shutil.rmtree(place, ignore_errors=True)
        parts = generator.write(task, folder / name, folder / "truth" / name)
        click.echo(f"{name}: {len(parts)} parts", err=True)


def command(generator: Generator) -> click.Command:
    """What `python -m` of the generator's package does."""
    place, plans = Path("out") / generator.name, (generator.plan, *generator.later)

    @click.command(
        context_settings={"help_option_names": ["-h", "--help"]},
        help=f"Examine `pido diagnose` and `pido correct` on {generator.about}.\n\n"
        f"\b\npython -m {generator.package} --cases 50 --seed 1 --workers 2 --out {place}",
    )
    @click.option("--cases", default=50, show_default=True, help="how many are planned")
    @click.option("--seed", default=1, show_default=True)
    @click.option("--edition", type=click.IntRange(1, len(plans)), default=1, show_default=True,
                  hidden=len(plans) == 1, help="further machines and laws of the same generator")  # fmt: skip
    @click.option("--from", "first", default=0, show_default=True, help="first case of the plan to ask")
    @click.option("--to", "last", type=int, help="the case before which to stop  [default: all]")
    @click.option("--group", "groups", multiple=True, type=click.Choice(list(GROUPS)),
                  help="only cases of this group, may be given again; --from and --to count in the whole plan and a "
                       "case keeps its number there  [default: all groups]")  # fmt: skip
    @click.option("--workers", default=1, show_default=True, help="cases at a time, each in a process with one thread")
    @click.option("--out", type=click.Path(path_type=Path), default=place, show_default=True)
    @click.option("--draw", "drawn", type=click.Path(path_type=Path), help="only write the cases and their truth here")
    @click.option("--one", hidden=True)
    def main(
        cases: int,
        seed: int,
        edition: int,
        first: int,
        last: int | None,
        groups: tuple[str, ...],
        workers: int,
        out: Path,
        drawn: Path | None,
        one: str | None,
    ) -> None:
        if one:
            click.echo(json.dumps(solve(generator, Task(**json.loads(one)), out)))
            return
        tasks = chosen(plans[edition - 1](cases, seed), first, last, groups)
        if not tasks:
            raise click.UsageError(f"No such case among {cases} that are planned: plan more of them with --cases.")
        if drawn:
            only_draw(generator, tasks, drawn)
            return
        try:
            rows = examine(generator, list(tasks.values()), out.resolve(), workers)
        except PidoError as error:
            raise click.ClickException(str(error)) from None
        for title, table in tables(rows).items():
            if len(table):
                click.echo(f"\n{title}\n{table.to_string(index=False)}")

    return main
