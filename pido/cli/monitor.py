"""`pido monitor`: the residual of a part against the band; a growing file as it is written; answers to alarms."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from pido.cli.places import existing, workspace_option

if TYPE_CHECKING:
    from pido.supervision.part import Judgement


class _PartOrAnswer(click.Group):
    """`pido monitor PART`, and `pido monitor answer ALARM`: a part called "answer" is reached by its path or digest."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        if args and not ({args[0]} & {"answer", "part", "-h", "--help"}):
            args = ["part", *args]
        return super().parse_args(ctx, args)


@click.group(cls=_PartOrAnswer)
def command() -> None:
    """Judge a part against what the champion expects, within a band that earlier parts justify.

    `pido monitor part --help` lists the options: --follow, --tolerate, --json and more.

    This is quality information and no safety stop: it never protects a person or a machine.

    \b
    pido monitor parts/p07 --workspace plant
    pido monitor --follow recording.csv --workspace plant --machine cmx600v
    pido monitor answer 3fa94c01be --true --by "A. Ito" --reason "insert was chipped" --workspace plant
    """


@command.command(name="part", short_help="Judge a part, as `pido monitor PART` does.")
@click.argument("part", required=False)
@workspace_option
@click.option("--machine", default=None, help="machine of a recording that does not name its own")
@click.option("--tolerate", type=click.FloatRange(0, 100, min_open=True, max_open=True), default=1.0, show_default=True,
              help="false alarms per 100 good parts, all axes together")  # fmt: skip
@click.option("--follow", type=click.Path(dir_okay=False, path_type=Path), help="a CSV file that is being written")
@click.option("--idle-s", type=click.FloatRange(0), default=10.0, show_default=True,
              help="with --follow: the part has ended when the file did not grow for so long, s")  # fmt: skip
@click.option("--json", "as_json", is_flag=True, help="for a machine to read; with --follow, one line per alarm")
def of_part(
    part: str | None,
    folder: Path,
    machine: str | None,
    tolerate: float,
    follow: Path | None,
    idle_s: float,
    as_json: bool,
) -> None:
    """PART is a recording (file or part folder), or the name or digest of a part in the store.

    Verdict and alarms go into the workspace's book; the recording itself is not taken in. Quality information, no
    safety stop.

    \b
    pido monitor parts/p07 --workspace plant
    pido monitor --follow recording.csv --workspace plant
    """
    if (part is None) == (follow is None):
        raise click.UsageError("give a PART, or a growing file with --follow")
    from pido.supervision import NO_SAFETY_STOP

    workspace = existing(folder)
    if follow is not None:
        from pido.supervision.stream import follow_file

        for event in follow_file(workspace, follow, machine=machine, tolerate=tolerate, idle_s=idle_s):
            click.echo(json.dumps(event, sort_keys=True) if as_json else _event(event))
        return
    from pido.supervision.part import keep, monitor

    assert part is not None
    judgement = monitor(workspace, part, machine=machine, tolerate=tolerate)
    keep(workspace, judgement)
    if as_json:
        answered = {a.id: a.answered for a in judgement.alarms if a.answered}
        record = {**judgement.record(), "answered": answered, "no_safety_stop": NO_SAFETY_STOP}
        click.echo(json.dumps(record, indent=1, sort_keys=True))
        return
    for line in lines(judgement):
        click.echo(line)
    for note in judgement.notes:
        click.echo(note, err=True)
    click.echo(NO_SAFETY_STOP, err=True)


@command.command()
@click.argument("alarm_id")
@click.option("--true/--false", "true", required=True, help="whether something was really wrong")
@click.option("--by", required=True, help="who says so")
@click.option("--reason", required=True, help="why")
@workspace_option
def answer(alarm_id: str, true: bool, by: str, reason: str, folder: Path) -> None:
    """Say what an alarm was. False: the band widens. True: its samples are not learnt from, from the next training on.

    \b
    pido monitor answer 3fa94c01be --true --by "A. Ito" --reason "insert was chipped" --workspace plant
    """
    from pido.supervision.book import find_alarm

    book = find_alarm(existing(folder), alarm_id)
    alarm = book.answer(alarm_id, true=true, by=by, reason=reason)
    follows = (
        "its samples are left out of the next training set" if true else "the band learns from this part, and widens"
    )
    click.echo(f"{book.machine}, part {alarm['part']}, axis {alarm['axis']}: a {str(true).lower()} alarm; {follows}")


def lines(judgement: Judgement) -> list[str]:
    """The verdict, then one line per alarm."""
    from pido.supervision.part import named

    head = "nothing unusual" if judgement.verdict.good else f"{len(judgement.alarms)} alarm(s)"
    band = judgement.band
    first = f"{judgement.part}   {head}   ({judgement.model}; band from {band.parts} part(s), "
    first += f"{band.tolerate:g} false alarm(s) per 100 parts tolerated)"
    return [first, *(f"  {a.id}  {in_a_line(named(a))}{a.answered and f' ({a.answered})'}" for a in judgement.alarms)]


def in_a_line(alarm: dict[str, Any]) -> str:
    """Axis, block, time, size, and what it looks like, for an operator.

    >>> in_a_line({"axis": "x", "block": 120, "t_start": 41.2, "t_end": 42.0, "size_a": 0.35, "spreads": 7.2,
    ...            "tool": "1", "looks_like": "cutting_force"})
    'axis x, 41.2 to 42.0 s, NC block 120, tool 1: +0.35 A (7.2 spreads); looks like the process force while cutting'
    """
    from pido.reports.words import in_words

    place = [f"axis {alarm['axis']}", f"{alarm['t_start']:.1f} to {alarm['t_end']:.1f} s"]
    place += [f"NC block {alarm['block']}"] if alarm["block"] >= 0 else []
    place += [f"tool {alarm['tool']}"] if alarm["tool"] else []
    guess = alarm.get("looks_like", "unknown")
    like = "looks like nothing known" if guess == "unknown" else f"looks like {in_words(guess)}"
    return f"{', '.join(place)}: {alarm['size_a']:+.3g} A ({abs(alarm['spreads']):.1f} spreads); {like}"


def _event(event: dict[str, Any]) -> str:
    if event["kind"] == "end":
        return (
            f"{event['part']}   {'nothing unusual' if event['good'] else 'alarms above'}   ({event['samples']} samples)"
        )
    return event["message"] if "message" in event else in_a_line(event)
