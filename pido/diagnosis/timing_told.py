"""What a delay of the recording is called: in words, in numbers, and what to do about it.

In:  `Delay` and the names of the parts.
Out: sentences and `Estimate` values of its finding.
"""

from __future__ import annotations

from collections.abc import Sequence

from pido.diagnosis.finding import Estimate
from pido.diagnosis.timing import Delay, Step

_WELL_KNOWN_S = 0.5  # a moment whose interval is no wider is told as one
_MOST_NAMED = 4  # parts that are in time
_WHOLE = 0.25  # of a sample: a step that is as near to a whole number of them is told as so many samples


def parameters_of(delay: Delay, parts: Sequence[str]) -> dict[str, Estimate]:
    """shift, s : of all parts, where they have one in common, or the mean of their own; shift_<part> of each part where
    not all are alike; drift, s/s; step_<part> and from_<part>, s : how much later a part comes from when on."""
    out: dict[str, Estimate] = {}
    if delay.offset or delay.drift or delay.in_most or not (delay.steps or delay.own):
        out["shift"] = _estimated(delay.offset, "s", delay.sd[0])
    if delay.own:
        each = zip(parts, delay.offsets, delay.sds, strict=True)
        out |= {f"shift_{part}": _estimated(offset, "s", sd) for part, offset, sd in each}
    if delay.drift:
        out["drift"] = _estimated(delay.drift, "s/s", delay.sd[1])
    for step, name in zip(delay.steps, _names(delay, parts), strict=True):
        out[f"step_{name}"] = _estimated(step.size, "s", step.sd)
        out[f"from_{name}"] = Estimate(step.time, "s", step.times)
    return out


def equation_of(delay: Delay, axis: str) -> str:
    """
    >>> from pido.diagnosis.clocks import Form
    >>> steps = (Step(2, 36.56, -0.05, 1e-4, (36.5, 36.6)),)
    >>> equation_of(Delay((0.0,) * 3, 0.0, (0.0, 0.0), 90.0, {"x": 90.0}, (0.0,) * 3, Form(), steps), "x")
    'curr_x(t) = I_sim(t - step), with a step in one part'
    """
    shift = delay.offset or delay.own or delay.drift or not delay.steps
    terms = [name for name, there in (("shift", shift), ("drift * t", delay.drift), ("step", delay.steps)) if there]
    out = f"curr_{axis}(t) = I_sim(t - {' - '.join(terms)})"
    if delay.own:
        out += ", with another shift in each part" if delay.in_most else ", with another shift in some parts"
    if delay.steps:
        out += ", with a step in one part" if len(delay.steps) == 1 else f", with {len(delay.steps)} steps"
    return out


def scheme_of(delay: Delay, parts: Sequence[str]) -> str:
    """What was fitted."""
    said = ["one shift for all parts"] if not delay.own and (delay.offset or delay.drift or not delay.steps) else []
    if delay.own:
        own = listed([parts[k] for k in sorted(delay.form.own)])
        said += ["one shift in each part" if delay.in_most else f"one shift in each of {own}"]
    said += [f"one step in time in {parts[step.part]}" for step in delay.steps]
    return listed(said)


def late_in_words(delay: Delay, parts: Sequence[str]) -> str:
    """By how much the recording comes after or before the simulation, and where."""
    steps = [_of_step(delay, step, parts) for step in delay.steps]
    return "; ".join([*_shifts(delay, parts), *steps, *_in_time(delay, parts)])


def said_of(delay: Delay, parts: Sequence[str], dt: float) -> str:
    """What it is, where it is steps and nothing else; '' where the name of the finding says it."""
    if not delay.steps or delay.own or delay.offset or delay.drift or any(s.doubtful for s in delay.steps):
        return ""
    places = [f"{_happened(s, dt)} in the recording of {parts[s.part]} at {s.time:.1f} s" for s in delay.steps]
    return f"{listed(places)}: it is shifted in time from then on"


def advice_of(delay: Delay, parts: Sequence[str], dt: float) -> str:
    """What to do about steps; '' where there are none."""
    if not delay.steps:
        return ""
    if any(s.doubtful for s in delay.steps):
        named = listed(list(dict.fromkeys(parts[s.part] for s in delay.steps if s.doubtful)))
        return f"compare the clock of the recording of {named} with that of the control at its start and its end"
    places = [f"of {parts[s.part]} at {s.time:.1f} s ({_happened(s, dt)})" for s in delay.steps]
    return (
        f"look at how the recording {listed(places)} was written: its time column runs on as if nothing had happened. "
        "Export it again, or cut the part there in two"
    )


def _shifts(delay: Delay, parts: Sequence[str]) -> list[str]:
    """Of whole parts."""
    drift = f" at t = 0 and {_size(60 * delay.drift)} {'later' if delay.drift > 0 else 'earlier'} every minute"
    drifting = drift if delay.drift else ""
    if delay.in_most:
        low, high = (pick(range(len(parts)), key=delay.offsets.__getitem__) for pick in (min, max))
        ends = [f"{_after(delay.offsets[k])} in part {parts[k]}" for k in (low, high)]
        return [f"by another time in each part, from {ends[0]} to {ends[1]}{drifting}"]
    if delay.own:
        said = [f"{_after(delay.offsets[k])} in part {parts[k]}{drifting}" for k in sorted(delay.form.own)]
        return [*said, *([f"{_after(delay.offset)} in all others{drifting}"] * bool(delay.offset or delay.drift))]
    return [_after(delay.offset) + drifting] if delay.offset or delay.drift or not delay.steps else []


def _in_time(delay: Delay, parts: Sequence[str]) -> list[str]:
    """Whose recording is not accused."""
    whole = [p for k, p in enumerate(parts) if k not in delay.late]
    if not whole or not delay.late:
        return []
    if len(whole) > _MOST_NAMED:
        return ["the other parts are in time"]
    return [f"part{'s' if len(whole) > 1 else ''} {listed(whole)} {'are' if len(whole) > 1 else 'is'} in time"]


def _of_step(delay: Delay, step: Step, parts: Sequence[str]) -> str:
    """
    By how much, where and from when on; as much more where the part was not in time before."""
    before = delay.drift or delay.offsets[step.part]
    before = before or any(s.part == step.part and s.time < step.time for s in delay.steps)
    size = _more(step.size) if before else _after(step.size)
    happened = f"samples {'lost' if step.size < 0 else 'repeated'} there"
    if step.doubtful:
        happened = "a clock that drifts in this part alone explains as much"
    return f"{size} in part {parts[step.part]} from {_moment(step)} on ({happened})"


def _moment(step: Step) -> str:
    """When it was, as well as it is known."""
    low, high = step.times
    if high - low <= _WELL_KNOWN_S:
        return f"{step.time:.2f} s"
    return f"a moment between {low:.1f} and {high:.1f} s"


def _happened(step: Step, dt: float) -> str:
    """
    >>> _happened(Step(2, 36.56, -0.05, 1e-4, (36.5, 36.6)), 0.01)
    '5 samples were lost'
    """
    count = abs(step.size) / dt
    whole = abs(count - round(count)) < _WHOLE and round(count) >= 1
    many = (
        f"{round(count)} sample{'s' if round(count) > 1 else ''}"
        if whole
        else f"samples of {1e3 * abs(step.size):.3g} ms"
    )
    return f"{many} {'was' if whole and round(count) == 1 else 'were'} {'lost' if step.size < 0 else 'repeated'}"


def _names(delay: Delay, parts: Sequence[str]) -> list[str]:
    """Of each step, unlike: of the second in a part and those after it with its number."""
    out = []
    for i, step in enumerate(delay.steps):
        nth = 1 + sum(s.part == step.part for s in delay.steps[:i])
        out.append(parts[step.part] + (f"_{nth}" if nth > 1 else ""))
    return out


def _after(seconds: float) -> str:
    return f"{_size(seconds)} {'after' if seconds > 0 else 'before'} the simulation"


def _more(seconds: float) -> str:
    return f"{_size(seconds)} {'later' if seconds > 0 else 'earlier'} than before"


def _size(seconds: float) -> str:
    return f"{abs(seconds):.4g} s" if abs(seconds) >= 1.0 else f"{abs(seconds) * 1e3:.3g} ms"


def listed(names: Sequence[str]) -> str:
    """
    >>> listed(["p1", "p2", "p4"])
    'p1, p2 and p4'
    """
    return " and ".join(filter(None, (", ".join(names[:-1]), names[-1])))


def _estimated(value: float, unit: str, sd: float) -> Estimate:
    return Estimate(value, unit, (value - 1.96 * sd, value + 1.96 * sd))
