"""False alarms and detection of the monitor on parts of a virtual machine.

    python -m benchmarks.monitoring
    python -m benchmarks.monitoring --machines 4 --watched 12 --first-seed 900

Rows of {work, peer, ratio, goal, error}. Two kinds of production, neither used for tuning:

    series  the same program again and again, as a plant makes most of its parts
    family  every part another program, with other feeds, speeds, depths and tools

After K parts: a model on their rows, a band from residuals that it had not seen, then good parts and the same parts
with a load change: process forces and torque 20 % up for 0.5 to 2 s of a cut, through the drives' own dynamics. Where
it moves the window mean of no axis by DETECTABLE spreads of that mean's noise, no band with so few false alarms can see
it, whatever its model; such changes are counted apart. The peer is what a control's own monitor does: an envelope
around the taught parts, widened by 10 % of its range, at the same place of the program.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import click
import numpy as np

from pido.core.axes import AXES
from pido.core.machining import Machine
from pido.core.samples import Samples
from pido.models.axis_models import AxisModels
from pido.models.inputs import model_inputs
from pido.monitoring.alarms import judge
from pido.monitoring.band import learn
from pido.monitoring.doubt import Support
from pido.monitoring.residuals import PartResiduals, window_mean, window_samples
from pido.process.samples import to_samples
from pido.supervision.residuals import Said, in_stretches, on_the_clock
from pido.synthetic import families
from pido.synthetic.machine import Produced, VirtualMill, produce
from pido.synthetic.mills import newer_vertical, worn_horizontal
from pido.synthetic.parts import Course

SHARE = 0.2
DETECTABLE = 6.0
QUICK: dict[str, Any] = {"machines": 1, "watched": 4}


@dataclass(frozen=True)
class Counts:
    good: int = 0
    alarmed: int = 0
    changed: int = 0
    found: int = 0
    peer_alarmed: int = 0
    peer_found: int = 0
    invisible: int = 0

    def __add__(self, other: Counts) -> Counts:
        return Counts(**{f.name: getattr(self, f.name) + getattr(other, f.name) for f in fields(Counts)})


def run(machines: int = 6, watched: int = 20, first_seed: int = 900) -> list[dict[str, Any]]:
    """machines : virtual machines per kind; watched : good parts on each, and as many with a load change."""
    rows: list[dict[str, Any]] = []
    for kind in ("series", "family"):
        totals = {1: Counts(), 3: Counts()}
        for seed in range(first_seed, first_seed + machines):
            for known, counts in campaign(kind, seed, watched).items():
                totals[known] += counts
                click.echo(f"{kind} {seed} after {known}: {counts}", err=True)
        for known, c in totals.items():
            goal = "<= 2" if known == 1 else "<= 1"
            peer = f"envelope +10 %: {100 * c.peer_alarmed / max(c.good, 1):.1f}" if kind == "series" else "–"
            rows.append(_row(f"false alarms per 100 good parts after {known} part(s), {kind}", peer,
                             100 * c.alarmed / max(c.good, 1), goal, f"{c.alarmed} of {c.good}"))  # fmt: skip
            peer = f"envelope +10 %: {100 * c.peer_found / max(c.changed, 1):.0f} %" if kind == "series" else "–"
            rows.append(_row(f"detection of +20 % load for 0.5-2 s after {known} part(s), {kind}, %", peer,
                             100 * c.found / max(c.changed, 1), ">= 95" if known == 3 else "–",
                             f"{c.found} of {c.changed}; {c.invisible} below the noise, not counted"))  # fmt: skip
    return rows


def campaign(kind: str, seed: int, watched: int) -> dict[int, Counts]:
    """One machine: counts after one and after three parts."""
    mill, courses = _production(kind, seed, watched + 3)
    parts = [produce(mill, [c], seed=1000 * seed + i, with_simulation=False)[0] for i, c in enumerate(courses)]
    samples = [to_samples(p.recording, mill.machine, p.job.name) for p in parts]
    rng = np.random.default_rng(seed)
    changed = [
        load_change(mill, courses[i], parts[i], rng, 1000 * seed + i) if i >= 3 else None for i in range(len(parts))
    ]
    result = {}
    for known in (1, 3):
        band = learn(_held_out(parts[:known], samples[:known], mill.machine))
        models, near = _learnt(samples[:known])
        counts = Counts()
        for i in range(3, len(parts)):
            good = _residuals(parts[i], samples[i], models, near, mill.machine)
            counts += Counts(good=1, alarmed=bool(judge(good, band).alarms))
            counts += Counts(peer_alarmed=kind == "series" and _envelope(parts[:known], parts[i]))
            found = changed[i]
            if found is None:
                continue
            bad, (start, end) = found
            if _visibility(parts[i], bad, start, end) < DETECTABLE:
                counts += Counts(invisible=1)
                continue
            rows = to_samples(bad.recording, mill.machine, "changed")
            alarms = judge(_residuals(bad, rows, models, near, mill.machine), band).alarms
            hit = any(a.t_start <= end + band.window_s and a.t_end >= start for a in alarms)
            counts += Counts(changed=1, found=hit, peer_found=kind == "series" and _envelope(parts[:known], bad))
        result[known] = counts
    return result


def load_change(
    mill: VirtualMill, course: Course, good: Produced, rng: np.random.Generator, seed: int
) -> tuple[Produced, tuple[float, float]] | None:
    """The same part with SHARE more process load for a while of one cut, and when; None where no cut is long enough.
    What was simulated for the part stays what it was."""
    loaded = course.cutting & (course.torque > 0.5 * np.median(course.torque[course.cutting]))
    for _ in range(300):
        length = rng.uniform(0.5, 2.0)
        start = rng.uniform(0.0, course.time[-1] - length)
        during = (course.time >= start) & (course.time < start + length)
        if loaded[during].mean() > 0.98:
            break
    else:
        return None
    more = 1.0 + SHARE * during
    other = replace(
        course, force={a: f * more for a, f in course.force.items()}, torque=course.torque * more,
        spindle_force=course.spindle_force * more,
    )  # fmt: skip
    made = produce(mill, [other], seed=seed, with_simulation=False)[0]
    currents = {f"curr_{a}": made.recording[f"curr_{a}"] for a in AXES}
    return replace(made, recording=good.recording.with_columns(**currents)), (start, start + length)


def _production(kind: str, seed: int, count: int) -> tuple[VirtualMill, list[Course]]:
    mill = newer_vertical() if seed % 2 == 0 else worn_horizontal()
    rng = np.random.default_rng(seed)
    if kind == "family":
        return mill, mill.plan(families.random_contours(mill.machine, count, rng, seconds=60.0))
    first = families.random_contours(mill.machine, 1, rng, seconds=60.0)[0]
    jobs = [replace(first, name=f"s{k + 1:02d}", order=k + 1, start_time_s=240.0 * k) for k in range(count)]
    return mill, mill.plan(jobs)


def _held_out(parts: Sequence[Produced], samples: Sequence[Samples], machine: Machine) -> list[PartResiduals]:
    from pido.iteration import Recipe

    if len(parts) == 1:
        said, away = in_stretches(samples[0], Recipe(), 0, machine)
        inputs = model_inputs(samples[0], "extended")
        return [on_the_clock("0", parts[0].recording, samples[0], inputs, said, away)[0]]
    return [
        _residuals(parts[k], samples[k], *_learnt([s for j, s in enumerate(samples) if j != k]), machine)
        for k in range(len(parts))
    ]


def _learnt(samples: Sequence[Samples]) -> tuple[AxisModels, Support]:
    rows = Samples.concat(list(samples))
    return AxisModels.fit(rows), Support(model_inputs(rows, "extended"))


def _residuals(part: Produced, samples: Samples, models: AxisModels, near: Support, machine: Machine) -> PartResiduals:
    inputs = model_inputs(samples, "extended")
    said = Said.by(models, inputs, machine)
    return on_the_clock(part.job.name, part.recording, samples, inputs, said, near.distance(inputs))[0]


def _visibility(good: Produced, bad: Produced, start: float, end: float) -> float:
    """Largest change of an axis' window mean, in spreads of the noise of such a mean."""
    time = good.recording.time
    during = (time >= start) & (time < end)
    width = window_samples(good.recording.sample_rate_hz)
    sizes = []
    for axis in AXES:
        change = np.mean((bad.recording[f"curr_{axis}"] - good.recording[f"curr_{axis}"])[during])
        noise = window_mean(good.truth.noise[axis], width)
        sizes.append(abs(change) / float(np.nanstd(noise)))
    return max(sizes)


def _envelope(taught: Sequence[Produced], part: Produced) -> bool:
    """Whether a window mean leaves the taught parts' own, sample by sample, by a tenth of their range."""
    width = window_samples(part.recording.sample_rate_hz)
    for axis in AXES:
        means = [window_mean(p.recording[f"curr_{axis}"], width) for p in [*taught, part]]
        n = min(map(len, means))
        known, now = np.array([m[width - 1 : n] for m in means[:-1]]), means[-1][width - 1 : n]
        room = 0.1 * float(np.ptp(known))
        if (now > known.max(axis=0) + room).any() or (now < known.min(axis=0) - room).any():
            return True
    return False


def _row(work: str, peer: str, value: float, goal: str, error: str) -> dict[str, Any]:
    return {"work": work, "peer": peer, "ratio": round(value, 2), "goal": goal, "error": error}


@click.command()
@click.option("--machines", type=click.IntRange(min=1), default=6, show_default=True, help="per kind of production")
@click.option("--watched", type=click.IntRange(min=1), default=20, show_default=True, help="good parts on each")
@click.option("--first-seed", type=click.IntRange(min=0), default=900, show_default=True)
def main(machines: int, watched: int, first_seed: int) -> None:
    """Print the table; each machine is told as soon as it is done."""
    for line in run(machines, watched, first_seed):
        click.echo("  ".join(f"{v}" for v in line.values()))


if __name__ == "__main__":
    main()
