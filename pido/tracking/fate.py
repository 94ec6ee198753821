"""What became of a version, in words for its page.

In:  a version's number. Out: how a sentence about it ends; '' where it waits, and its gate's result says all there is.
"""

from __future__ import annotations

from pido.tracking import promotion
from pido.workspace import Workspace


def fate(workspace: Workspace, machine: str, version: int) -> str:
    """Of a version that is in force, was, was rejected, or passed its gate and is not today's."""
    standings = {s.version.version: s for s in promotion.standings(workspace, machine)}
    if version not in standings:
        return ""
    last = {r.version: r for r in promotion.history(workspace, machine)}.get(version)
    decided = f"by {last.by}, {last.at}: {last.reason}" if last else ""
    match standings[version].state:
        case "champion":
            return f"this version is in force ({decided})."
        case "rejected":
            return f"this version was rejected and stays so ({decided})."
        case "former champion":
            return "this version was in force, and another one is now."
        case "superseded" if standings[version].version.gate.get("passed"):
            today = [str(n) for n, s in standings.items() if s.state in ("challenger", "champion")]
            newer = f": {' and '.join(today)} took its place" if today else ""
            return f"this version is superseded{newer}."
    return ""
