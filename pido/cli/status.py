"""`pido status`: which version is in force, which waits, and what could not be used."""

from __future__ import annotations

import json
from pathlib import Path

import click

from pido.cli.places import existing, workspace_option


@click.command()
@workspace_option
@click.option("--json", "as_json", is_flag=True, help="for a machine to read")
@click.option("--history", is_flag=True, help="also every decision in the audit log")
def command(folder: Path, as_json: bool, history: bool) -> None:
    """Champion and challenger of each machine, the gate's words, and arrivals that were rejected.

    \b
    pido status --workspace plant --history
    """
    from dataclasses import asdict

    from pido.tracking import promotion
    from pido.tracking.ledger import Ledger

    workspace = existing(folder)
    ledger = Ledger(workspace.ledger)
    answer = {
        "machines": {
            machine: {
                "parts": len(ledger.parts(machine)),
                "versions": [{**asdict(s.version), "state": s.state} for s in promotion.standings(workspace, machine)],
                "decisions": [asdict(r) for r in promotion.history(workspace, machine)],
            }
            for machine in ledger.machines()
        },
        "rejected": [{"name": a.name, "reason": a.reason} for a in ledger.rejections()],
        "not_in_mlflow_yet": len(ledger.not_logged()),
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
        if history:
            for r in state["decisions"]:
                click.echo(f"  {r['at']}  {r['action']} {r['version']} by {r['by']}: {r['reason']}")
    if not answer["machines"]:
        click.echo("no iteration yet")
    for a in answer["rejected"]:
        click.echo(f"rejected  {a['name']}: {a['reason']}")
    if answer["not_in_mlflow_yet"]:
        click.echo(f"{answer['not_in_mlflow_yet']} iteration(s) wait to be logged to MLflow")
