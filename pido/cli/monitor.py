"""`pido monitor`: the residual of a part against the band; a growing file as it is written; answers to alarms."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from pido.cli.places import existing, workspace_option

if TYPE_CHECKING:
    from pido.supervision.part import Judgement

UNJUDGED = 3
"""Exit code of a part of which too little could be judged to call it good."""


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
@click.option(
    "--json",
    "as_json",
    is_flag=True,
    help="for a machine to read; with --follow, a line as an alarm begins, as it has ended, and at the end",
)
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

    Verdict and alarms go into the workspace's book; the recording itself is not taken in. A part without an alarm of
    which less than half could be judged is "not judged", and the exit code is 3. Quality information, no safety stop.

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

        event: dict[str, Any] = {}
        for event in follow_file(workspace, follow, machine=machine, tolerate=tolerate, idle_s=idle_s):
            click.echo(json.dumps(event, sort_keys=True) if as_json else _event(event))
        sys.exit(_status(event))
    from pido.supervision.part import keep, monitor

    assert part is not None
    judgement = monitor(workspace, part, machine=machine, tolerate=tolerate)
    keep(workspace, judgement)
    record = judgement.record()
    if as_json:
        answered = {a.id: a.answered for a in judgement.alarms if a.answered}
        record |= {"answered": answered, "no_safety_stop": NO_SAFETY_STOP}
        click.echo(json.dumps(record, indent=1, sort_keys=True))
        sys.exit(_status(record))
    for line in lines(judgement):
        click.echo(line)
    for note in judgement.notes:
        click.echo(note, err=True)
    click.echo(NO_SAFETY_STOP, err=True)
    sys.exit(_status(record))


@command.command()
@click.argument("alarm_id")
@click.option("--true/--false", "true", required=True, help="whether something was really wrong")
@click.option("--by", required=True, help="who says so")
@click.option("--reason", required=True, help="why")
@workspace_option
def answer(alarm_id: str, true: bool, by: str, reason: str, folder: Path) -> None:
    """Say what an alarm was. False: the band learns from its part, and widens. True: its samples are not learnt from.

    Either takes effect once the part is taken in and has gone through an iteration: what was only looked at is not
    learnt from. Alarms of earlier verdicts can be answered too.

    \b
    pido monitor answer 3fa94c01be --true --by "A. Ito" --reason "insert was chipped" --workspace plant
    """
    from pido.supervision.book import find_alarm

    book = find_alarm(existing(folder), alarm_id)
    alarm = book.answer(alarm_id, true=true, by=by, reason=reason)
    said = f"{book.machine}, part {alarm['part']}, axis {alarm['axis']}: a {str(true).lower()} alarm"
    click.echo(f"{said}; {_consequence(true, known=book.learnt_from(alarm['digest']), name=_followed(alarm))}")


def _followed(alarm: dict[str, Any]) -> str:
    from pido.monitoring.records import name_in

    return name_in(alarm["digest"]) or ""


def _consequence(true: bool, *, known: bool, name: str) -> str:
    """known : whether models and band have the part already; name : that it has to be taken in under, if it matters"""
    if known and true:
        return "its samples are left out of the next training set"
    if known:
        return "the band learns from this part, and widens"
    until = f"the part is taken in under the name '{name}'" if name else "the part is taken in"
    if true:
        return f"its samples are left out of training once {until}; nothing changes before"
    return f"the band widens by it once {until} and iterated; nothing changes before"


def lines(judgement: Judgement) -> list[str]:
    """The verdict, then one line per alarm."""
    from pido.supervision.part import headline, named

    band = judgement.band
    first = f"{judgement.part}   {headline(judgement.record())}   ({judgement.model}; band from {band.parts} part(s), "
    first += f"{band.tolerate:g} false alarm(s) per 100 parts tolerated)"
    return [first, *(f"  {a.id}  {in_a_line(named(a))}{a.answered and f' ({a.answered})'}" for a in judgement.alarms)]


def in_a_line(alarm: dict[str, Any]) -> str:
    """Axis, block, time, size, and what it looks like once that is known, for an operator.

    >>> in_a_line({"axis": "x", "block": 120, "t_start": 41.2, "t_end": 42.0, "size_a": 0.35, "spreads": 7.2,
    ...            "tool": "1", "looks_like": "cutting_force"})
    'axis x, 41.2 to 42.0 s, NC block 120, tool 1: +0.35 A (7.2 spreads); looks like the process force while cutting'
    """
    from pido.reports.words import in_words

    place = [f"axis {alarm['axis']}", f"{alarm['t_start']:.1f} to {alarm['t_end']:.1f} s"]
    place += [f"NC block {alarm['block']}"] if alarm["block"] >= 0 else []
    place += [f"tool {alarm['tool']}"] if alarm["tool"] else []
    line = f"{', '.join(place)}: {alarm['size_a']:+.3g} A ({abs(alarm['spreads']):.1f} spreads)"
    if "looks_like" not in alarm:
        return line
    guess = alarm["looks_like"]
    return f"{line}; looks like {'nothing known' if guess == 'unknown' else in_words(guess)}"


def _event(event: dict[str, Any]) -> str:
    if event["kind"] == "end":
        from pido.supervision.part import headline

        return f"{event['part']}   {headline(event)}   ({event['model']}; {event['samples']} samples)"
    return f"  {event['id']}  {'begins' if event['kind'] == 'alarm' else 'has ended'}: {in_a_line(event)}"


def _status(record: dict[str, Any]) -> int:
    from pido.supervision.part import NOT_JUDGED

    return UNJUDGED if record["verdict"] == NOT_JUDGED else 0
