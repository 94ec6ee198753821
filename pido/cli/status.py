"""`pido status`: which version is in force, which waits, and what could not be used."""

from __future__ import annotations

import json
import os
from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from pido.cli.places import existing, workspace_option

if TYPE_CHECKING:
    from pido.monitoring.alarms import Alarm


@click.command()
@workspace_option
@click.option("--json", "as_json", is_flag=True, help="for a machine to read")
@click.option("--history", is_flag=True, help="also every decision in the audit log")
def command(folder: Path, as_json: bool, history: bool) -> None:
    """Champion and challenger of each machine, the gate's words, accepted physics, and arrivals that lie in a watched
    inbox and are still to be done, or that were rejected and not put right since (a later one of the same name and
    machine was taken in); diagnoses that were asked for and are not done.

    \b
    pido status --workspace plant --history
    """
    from dataclasses import asdict

    from pido import wanted
    from pido.backlog import standing
    from pido.core.clock import utc
    from pido.core.names import one_line
    from pido.physics_journal import in_force, journal, outcome
    from pido.supervision.book import Book
    from pido.tracking import promotion, whereabouts
    from pido.tracking.ledger import Ledger
    from pido.tracking.moved import left_behind
    from pido.tracking.withdrawn import parts, withdrawn
    from pido.workspace import without_secrets

    workspace = existing(folder)
    ledger = Ledger(workspace.ledger)
    now = {machine: promotion.champion(workspace, machine) for machine in ledger.machines()}
    physics = {machine: journal(workspace, machine) for machine in ledger.machines()}
    logged_at, there = whereabouts.elsewhere(workspace)
    last = {machine: (done[-1].version, done[-1].summary.get("physics", {})) if done else (0, {})
            for machine in ledger.machines() for done in [ledger.iterations(machine)]}  # fmt: skip
    answer = {
        "machines": {
            machine: {
                "parts": len(parts(workspace, machine)),
                "withdrawn": [
                    {"part": r.name, "digest": r.part, "by": r.by, "at": r.at, "reason": r.reason}
                    for r in withdrawn(workspace, machine).values()
                ],
                "open_alarms": _counted(Book(workspace, machine).open_alarms()),
                "learnt_from_withdrawn": promotion.trained_on_withdrawn(workspace, machine),
                "trained_with_revoked": promotion.trained_on_revoked(workspace, machine),
                "versions": [
                    {**asdict(s.version), "state": s.state, "judged_again": promotion.outdated(s.version, now[machine])}
                    for s in promotion.standings(workspace, machine)
                ],
                "physics": [{**asdict(e), "outcome": outcome(e, *last[machine])} for e in in_force(physics[machine])],
                "physics_decisions": [asdict(e) for e in physics[machine]],
                "decisions": [asdict(r) for r in promotion.history(workspace, machine)],
            }
            for machine in ledger.machines()
        },
        "rejected": [
            {
                "name": a.name,
                "reason": a.reason,
                "machine": a.machine,
                "at": utc(a.at),
                "lies": str(workspace.root / a.lies) if a.lies and os.path.lexists(workspace.root / a.lies) else "",
            }
            for a in ledger.rejections()
        ],
        "still_to_do": [asdict(one) for one in standing(workspace)],
        "diagnoses_to_do": [asdict(one) | {"state": wanted.words(workspace, one)} for one in wanted.wanted(workspace)],
        "not_in_mlflow_yet": len(ledger.not_logged(there or workspace.tracking_place)),
        "mlflow_at": logged_at or without_secrets(workspace.tracking_uri),
        "mlflow_looks_in": left_behind(workspace),
    }
    if as_json:
        click.echo(json.dumps(answer, indent=1, sort_keys=True))
        return
    for machine, state in answer["machines"].items():
        click.echo(f"{machine}: {state['parts']} part(s), {len(state['versions'])} version(s)")
        for v in state["versions"]:
            if v["state"] != "superseded":
                gate = "gate passed" if v["gate"].get("passed") else "gate not passed"
                click.echo(f"  version {v['version']:>3}  {v['state']:<15} {gate}: {v['gate'].get('words', '')}")
                if v["state"] == "challenger" and v["judged_again"]:
                    click.echo(
                        "               not compared with the champion in force: approving judges it again first"
                    )
                judged_by = v["gate"].get("parts", ())
                if v["state"] == "challenger" and (n := sum(state["open_alarms"].get(p, 0) for p in judged_by)):
                    click.echo(f"               judged by parts with {n} unanswered alarm(s)")
                if v["state"] == "champion" and (gone := state["learnt_from_withdrawn"].get(v["version"])):
                    click.echo(f"               has learnt from what is withdrawn: {', '.join(gone)}")
                if v["state"] == "champion" and (gone := state["trained_with_revoked"].get(v["version"])):
                    click.echo(f"               was trained with physics that is revoked: {', '.join(gone)}")
        if state["open_alarms"]:
            n, on = sum(state["open_alarms"].values()), ", ".join(d[:12] for d in state["open_alarms"])
            click.echo(f"  {n} unanswered alarm(s) of the monitor on part(s) {on}: `pido monitor PART` shows them")
        for r in state["withdrawn"]:
            about = f"{r['part']} ({r['digest'][:12]})  by {one_line(r['by'])}, {r['at']}: {one_line(r['reason'])}"
            click.echo(f"  withdrawn  {about}")
        for e in state["physics"]:
            click.echo(f"  physics {e['id']}  {e['outcome']} ({one_line(e['by'])}: {one_line(e['reason'])})")
        if history:
            decided = [(r["at"], _what(r), r) for r in state["decisions"]]
            decided += [(e["at"], f"{e['action']} physics {e['id']}", e) for e in state["physics_decisions"]]
            for at, what, who in sorted(decided, key=lambda d: d[0]):
                click.echo(f"  {at}  {what} by {one_line(who['by'])}: {one_line(who['reason'])}")
    if not answer["machines"]:
        click.echo("no iteration yet")
    for a in answer["rejected"]:
        about = "  ".join(filter(None, (a["at"], one_line(a["machine"]), one_line(a["name"]))))
        where = f", now in {one_line(a['lies'])}" if a["lies"] else ""
        why = a["reason"].partition(" Known are:\n")[0]  # the formats that there are: once is enough, beside the file
        click.echo(f"rejected  {about}{where}: " + "\n    ".join(map(one_line, why.splitlines())))
    for one in answer["still_to_do"]:
        tried = f", tried {one['tries']} time(s)" if one["tries"] else ", waiting"
        reason = f": {one_line(one['reason'])}" if one["reason"] else ""
        click.echo(f"still to do  {one_line(Path(one['path']).name)}{tried}{reason}")
    for one in answer["diagnoses_to_do"]:
        click.echo(f"diagnosis  {one_line(one['machine'])}: {one_line(one['state'])}")
    if logged_at:
        done = sum(len(ledger.iterations(machine)) for machine in now) - answer["not_in_mlflow_yet"]
        here = "`pido iterate --log-here`" if workspace.tracks_alone else "`pido iterate`"
        click.echo(f"{done} iteration(s) are {whereabouts.words(logged_at)}; {here} would log them here too")
    elif answer["not_in_mlflow_yet"]:
        where = "in MLflow where settings and environment have it now"
        click.echo(f"{answer['not_in_mlflow_yet']} iteration(s) are not {where}; `pido iterate` logs them")
    for there in answer["mlflow_looks_in"]:
        click.echo(f"MLflow looks for artifacts in {there}, where this workspace was; `pido iterate` puts that right")


def _what(record: dict[str, Any]) -> str:
    """A decision in a few words; what a later release has written as it says it, with all that it says."""
    from pido.core.names import one_line
    from pido.tracking import audit

    action = record["action"]
    if action in (*audit.VERSIONS, *audit.PARTS):
        return f"{action} {record['name'] or record['version']}"
    about = {k: record[k] for k in ("version", "name") if record[k]} | record["more"]
    said = ", ".join(f"{one_line(k)} {one_line(str(v))}" for k, v in about.items())
    return f"{one_line(action)} (of a later release: it decides nothing here{said and '; '}{said})"


def _counted(alarms: list[Alarm]) -> dict[str, int]:
    """By part (digest): how many."""
    return dict(Counter(alarm.part for alarm in alarms))
