"""What stands over an experiment, a run, a model and a version on MLflow's pages, for who has not met pido before.

In:  a machine, the summary of an iteration. Out: Markdown.
"""

from __future__ import annotations

from typing import Any

NOTE = "mlflow.note.content"
"""The tag that MLflow shows as the description of an experiment or a run."""
_LEGEND = """
**Metrics** are named *measure_axis/model* and are about the part that had just arrived, before any model of it was
trained on it. Axes: x, y, z, and sp, the spindle. Measures: rmse, mae, error_99 (99 % of the samples have a smaller
error) and peak (RMSE where the load is highest) in A; r2; n, samples. Models: real, trained on recorded rows; pia and
pie, with rows generated between recorded ones (physics-informed augmentation) or beyond them (exploration); both, the
one that is delivered; constant, friction line and nearest commands, trivial rivals that it has to beat.
balance: spread of the samples per bin that the coming part needs, before and after. seconds: what each stage took.

**Data sets**: real, the rows of the machine's recordings; pia and pie, the generated rows. *iteration/* among the
artifacts holds the figures, *report/index.html* the page to read first.
"""


def of_experiment(machine: str) -> str:
    """Of all runs of a machine."""
    return (
        f"Motor currents of machine **{_plain(machine)}**, predicted from its motion and the cutting forces. Each "
        "run is one iteration: a part has arrived, the physical equations were fitted again, and four models, one per "
        "axis, were trained on all parts so far. A gate compares them with the version in force; a person approves "
        "(`pido approve`, not MLflow's button *Promote model*).\n" + _LEGEND
    )


def of_run(summary: dict[str, Any], version: int) -> str:
    """The first thing an engineer reads on the run's page."""
    from pido.tracking.figures import markdown  # with a plotting library, which an experiment does not need

    lines = [
        f"**Version {version}** after part *{_plain(summary['part']['name'])}*, trained on "
        f"{len(summary['parts'])} part(s). Gate: {summary['gate'].get('words', '')}",
        "",
        *markdown(summary["metrics"]),
        *(f"\n{words}" for words in summary.get("physics", {}).get("words", [])),
        _LEGEND.rstrip(),
    ]
    return "\n".join(lines)


def of_model(axis: str, machine: str) -> str:
    """Of a registered model."""
    return (
        f"Motor current of {_of(axis)} of machine {machine} in A, from motion and cutting forces. In force is the "
        "version with the alias champion; challenger waits for approval (`pido approve`)."
    )


def of_version(axis: str, version: int, summary: dict[str, Any]) -> str:
    """Of one version of a registered model. summary : of its iteration in the ledger"""
    part, gate = summary.get("part", {}).get("name", ""), summary.get("gate", {}).get("words", "")
    after = f" after part {part}" if part else ""
    return f"Version {version}, {_of(axis)}{after}. Gate, over all axes: {gate}"


def _of(axis: str) -> str:
    return "the spindle" if axis == "sp" else f"axis {axis}"


def _plain(name: str) -> str:
    return name.replace("*", "")
