"""`make chaos`: faults that are really caused, at random moments, and what is left of them afterwards.

In:  how many faults, a seed.
Out: per kind: faults caused, attempts that were cut off, parts lost, parts doubled, whether the state at the end is
     the one of an undisturbed run (store, training data, equation and models by digest; champion and audit log).

First the faults that one process can have (`benchmarks.chaos_storm`; MLflow is told about nothing in these). Then a
whole plant is started and its services are killed (`benchmarks.plant_chaos`).
"""

from __future__ import annotations

import shutil
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import click

from benchmarks.chaos_attempts import Outcome, ended, start_process, take
from benchmarks.chaos_storm import Storm
from benchmarks.plant_chaos import VICTIMS, Plant, full_state, victims_of, zombies
from deploy import postgres
from pido.approval import approve
from pido.core.errors import SettingsError
from pido.recordings.folder import write_folder
from pido.tracking import promotion
from pido.tracking.ledger import Ledger
from pido.workspace import Workspace


def table(found: Sequence[Outcome]) -> str:
    """The outcomes as text."""
    lines = [f"{'fault':<28}{'faults':>7}{'cut off':>9}{'lost':>6}{'doubled':>9}  same as undisturbed"]
    lines += [
        f"{o.kind:<28}{o.faults:>7}{o.cut_off:>9}{o.lost:>6}{o.doubled:>9}  {'yes' if o.same else 'NO'}" for o in found
    ]
    lines.append(
        f"{'all':<28}{sum(o.faults for o in found):>7}{sum(o.cut_off for o in found):>9}"
        f"{sum(o.lost for o in found):>6}{sum(o.doubled for o in found):>9}  "
        f"{'yes' if all(o.same for o in found) else 'NO'}"
    )
    return "\n".join(lines)


class Undisturbed:
    """The same parts and decisions one after another, without servers and faults."""

    def __init__(self, place: Workspace, machine: str, log: Path) -> None:
        self.place, self.machine, self._log = place, machine, log

    def __call__(self, what: Path | tuple[str, ...]) -> dict[str, Any]:
        """Do it, and tell the state afterwards."""

        def attempt() -> None:
            if isinstance(what, Path):
                take(self.place, what)
            elif what[0] == "rollback":
                promotion.rollback(self.place, self.machine, by="chaos", reason="kills")
            else:
                approve(self.place, self.machine, int(what[1]), by="chaos", reason="kills")

        if not ended(start_process(attempt, self._log)):
            raise RuntimeError(f"{what} without a fault did not end well:\n{self._log.read_text()[-2000:]}")
        return full_state(self.place, self.machine)


def in_a_plant(storm: Storm, folders: Sequence[Path], kills: int) -> list[Outcome]:
    """The services of a plant killed `kills` times each during iterations, and again during promotions."""
    undisturbed = Undisturbed(storm.workspace(), storm.machine, storm.log())
    seeds, coming = list(folders[: -len(VICTIMS) - 1]), list(folders[-len(VICTIMS) - 1 :])
    for folder in seeds:
        undisturbed(folder)
        last = Ledger(undisturbed.place.ledger).versions(storm.machine)[-1]
        if last.gate.get("passed"):
            undisturbed(("approve", str(last.version)))
    if len(promotion.history(undisturbed.place, storm.machine)) < 2:
        raise RuntimeError("too few versions passed their gate to promote and roll back")
    folder = storm.root / "faulty"
    shutil.copytree(undisturbed.place.root, folder / "workspace")
    with Plant(folder, storm.root / "plant.log") as plant, plant.as_client():
        say = lambda line: click.echo(line, err=True)  # noqa: E731
        found = victims_of(plant, storm.machine, coming, undisturbed, kills, storm.rng, say)
        found.append(zombies(plant))
    left = plant.left()
    return [*found, Outcome("left after the plant's end", 0, 0, 0, len(left), not left)]


@click.command()
@click.option("--faults", type=click.IntRange(min=0), default=216, show_default=True, help="without a plant, about")
@click.option("--kills", type=click.IntRange(min=0), default=4, show_default=True, help="per service of a plant, twice")
@click.option("--seed", type=int, default=0, show_default=True)
@click.option("--rows", type=int, default=400, show_default=True, help="samples per part")
def main(faults: int, kills: int, seed: int, rows: int) -> None:
    """Cause faults and print what became of them; exit code 1 if anything was lost, doubled or different.

    \b
    python -m benchmarks.chaos --faults 210
    """
    from plain_parts import parts as made_up  # the tests' machine; `make chaos` puts its folder on the path

    with tempfile.TemporaryDirectory(prefix="pido-chaos-") as temporary:
        root = Path(temporary)
        root.chmod(0o755)
        short = [part.rows(slice(0, rows)) for part in made_up(12)]
        folders = [write_folder(p, root / p.part.part) for p in short]
        storm = Storm(root, folders[:3], short[0].part.machine, seed)
        click.echo(f"an undisturbed iteration takes {storm.seconds:.2f} s", err=True)
        share = faults / 8
        kinds = [
            (storm.killed, 2 * share), (storm.promotions, 2 * share), (storm.disk_full, share),
            (storm.clock, share / 2), (storm.read_only, share / 2), (storm.twice, share / 2), (storm.torn, share / 2),
            (storm.replaced, share / 2), (storm.mlflow_away, share / 4), (storm.heap, 200),
        ]  # fmt: skip
        found = []
        for cause, count in kinds if faults else ():
            found.append(cause(max(1, round(count))))
            click.echo(f"{found[-1].kind}: {'clean' if found[-1].clean else 'NOT CLEAN'}", err=True)
        if kills:
            try:
                postgres.programs()
                found += in_a_plant(storm, folders, kills)
            except SettingsError as error:
                click.echo(f"no plant: {error}", err=True)
        click.echo(table(found))
    sys.exit(0 if all(o.clean for o in found) else 1)


if __name__ == "__main__":
    main()
