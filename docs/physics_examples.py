"""What the page `physics.md` says of each mechanism: measured, one case each, the first seed and no other.

In:  the simulated mill (`pido.synthetic`), which shares no code with the search and integrates its own dynamics.
Out: `physics_examples.json`, and the page made from it and from the catalogue.

    python docs/physics_examples.py            measure what is missing, then what an earlier state of the finder
                                               answered, and write the page after each; one that was stopped goes on
                                               (20 minutes for all of it on a core of its own)
    python docs/physics_examples.py --only-page
"""

from __future__ import annotations

import hashlib
import json
import textwrap
from pathlib import Path
from typing import Any

import click

import pido.diagnosis
from pido.diagnosis.mechanisms import CATALOGUE
from pido.reports.words import in_words

HERE = Path(__file__).parent
MEASURED = HERE / "physics_examples.json"
PAGE = HERE / "physics.md"
STRENGTH, SEED, PARTS = 2.0, 1, 3
EXTRA = ("external_force", "input_fault", "miscalibrated:coulomb_friction", "unknown", "none")
KINDS = (*(m.id for m in CATALOGUE), *EXTRA)
FINDER = Path(pido.diagnosis.__file__).parent


def state_of_the_finder() -> str:
    """A digest of its sources: an answer of another state is said to be one."""
    files = sorted(FINDER.rglob("*.py"))
    return hashlib.sha256(b"".join(f.read_bytes() for f in files)).hexdigest()[:12]


def measure(kind: str) -> dict[str, Any]:
    """Conceal one thing, diagnose, and say both."""
    from pido.diagnosis.diagnose import diagnose
    from pido.synthetic.cases import draw_case

    case = draw_case(kind, STRENGTH, SEED, parts=PARTS)
    found = diagnose([part.recording for part in case.parts]).findings
    return {
        "truth": case.truth()["effects"],
        "found": [
            {
                "axis": f.axis,
                "mechanism": f.mechanism,
                "where": f.where.summary,
                "parameters": {n: [e.value, *e.ci95, e.unit] for n, e in f.parameters.items()},
                "rmse": [f.fit.rmse_before, f.fit.rmse_after],
                "alternatives": [a.mechanism for a in f.alternatives],
            }
            for f in found
        ],
    }


def verdict(kind: str, one: dict[str, Any]) -> str:
    """In how far the answer is the truth: named, named second, something else, or nothing."""
    found = one["found"]
    if kind == "none":
        return "nothing found, as it should be" if not found else "a finding where there is nothing"
    truth = {(e["axis"], e["mechanism"]) for e in one["truth"]}
    ids = [(f["axis"], f["mechanism"]) for f in found]
    if not found:
        return "not found"
    first = "named first" if ids[0] in truth else ""
    later = "named, but not first" if truth & set(ids) else ""
    axes = {axis for axis, _ in truth}
    second = any(f["axis"] in axes and {m for _, m in truth} & set(f["alternatives"]) for f in found)
    answer = first or later or ("stands as the alternative" if second else "taken for something else")
    others = sum(i not in truth for i in ids)
    return answer + (f"; {others} more" if others and (first or later) else "")


def page(measured: dict[str, Any]) -> str:
    """The whole page."""
    head = (HERE / "physics_head.md").read_text(encoding="utf-8")
    newest = next((one["finder"] for one in reversed(measured.values()) if "finder" in one), None)
    rows = ["| concealed | answer | found first | error on unseen parts, A |", "|---|---|---|---|"]
    for kind in KINDS:
        if kind not in measured:
            rows.append(f"| `{kind}` | not measured yet | – | – |")
            continue
        one = measured[kind]
        best = one["found"][0] if one["found"] else None
        first = f"{best['axis']}: `{best['mechanism']}`, {best['where']}" if best else "–"
        error = f"{best['rmse'][0]:.3g} → {best['rmse'][1]:.3g}" if best and best["mechanism"] != "input_fault" else "–"
        hidden = ", ".join(sorted({e["axis"] for e in one["truth"]}))
        earlier = "" if one.get("finder") == newest else " †"
        rows.append(
            f"| `{kind}`{f' ({hidden})' if hidden else ''}{earlier} | {verdict(kind, one)} | {first} | {error} |"
        )
    blocks = []
    for m in CATALOGUE:
        shape = f" Searched: {', '.join(f'{p.name} ({p.unit})' for p in m.shape)}." if m.shape else ""
        apart = [f"- from `{other}`: {what}" for other, what in m.tell_apart.items()]
        told = ["", "Tell it apart:", *apart] if apart else []
        text = [f"### `{m.id}`", "", f"{(m.__doc__ or '').strip().splitlines()[0]}", "",
                f"    {m.equation}", "", f"Axes: {', '.join(m.axes)}.{shape}", *told, ""]  # fmt: skip
        blocks.append("\n".join(text))
    done = [k for k in KINDS if k in measured]
    right = sum(verdict(k, measured[k]).startswith(("named first", "nothing found")) for k in done)
    figures = f"{right} of {len(done)} answers name what was concealed first (or find nothing where nothing is)."
    missed = [k for k in done if verdict(k, measured[k]).startswith(("not found", "taken for", "a finding where"))]
    if missed:
        figures += f" Missed altogether: {', '.join(f'`{k}`' for k in missed)}."
    if len(done) < len(KINDS):
        figures += f" {len(KINDS) - len(done)} of {len(KINDS)} are not measured yet and count for neither side."
    old = sum(measured[k].get("finder") != newest for k in done)
    if old:
        figures += f" {old} of the {len(done)} (†) were answered by an earlier state of the finder."
    figures = "\n".join(textwrap.wrap(figures, 120, break_long_words=False, break_on_hyphens=False))
    return head.replace("<!-- examples -->", f"{figures}\n\n" + "\n".join(rows)).replace(
        "<!-- catalogue -->", "\n".join(blocks).rstrip()
    )


@click.command()
@click.option("--only-page", is_flag=True, help="write the page from what has been measured")
def main(only_page: bool) -> None:
    """Measure, keep, write the page."""
    measured = json.loads(MEASURED.read_text(encoding="utf-8")) if MEASURED.exists() else {}
    state = state_of_the_finder()
    stale = [k for k in KINDS if k in measured and measured[k].get("finder") != state]
    for kind in () if only_page else [*(k for k in KINDS if k not in measured), *stale]:
        answer = {"finder": state, **measure(kind)}
        measured.pop(kind, None)
        measured[kind] = answer  # the newest stands last
        MEASURED.write_text(json.dumps(measured, indent=1), encoding="utf-8")
        PAGE.write_text(page(measured), encoding="utf-8")
        click.echo(f"{kind} ({in_words(kind)}): {verdict(kind, answer)}")
    PAGE.write_text(page(measured), encoding="utf-8")


if __name__ == "__main__":
    main()
