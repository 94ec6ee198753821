"""Which recording would tell what a law without a name is: by what it depends on, and by what went along with that.

In:  a term without a name, the states of its axis in the diagnosed parts.
Out: a sentence for the operator: what these data cannot tell, and the recording that would.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from pido.core.arrays import Float1D
from pido.core.axes import LINEAR_AXES
from pido.diagnosis.dynamics import Ringing
from pido.diagnosis.gates import PATH_SPEED
from pido.diagnosis.late import Behind
from pido.diagnosis.mechanisms.advice import in_digits, recording_that_shows
from pido.diagnosis.quantities import QUANTITIES, the
from pido.diagnosis.signals import CLOCKS, common_signals
from pido.diagnosis.state import AxisState
from pido.diagnosis.terms import Term
from pido.diagnosis.tools import ByTool

_ROWS = 4_000  # in which signals are compared
_GOES_WITH = 0.95  # correlation from which one signal may stand for another
_OTHERS = ("v_", "a_", "pos_", "feed", "f_", "M_sp", "MRR", "AR", "coolant")  # that may be what really counts
_BOTH_WAYS = tuple(f"v_{a}" for a in LINEAR_AXES)
_LOADS = ("f_", "M_sp", "MRR", "AR")
_SLOW_S = 3.0  # of what acts late: longer than moves last
_PER_PERIOD = 10  # samples of what rings


def recording_of_unknown(term: Term, states: Sequence[AxisState]) -> str:
    """The recording that would tell more, after what these data leave open; '' of a law that depends on nothing."""
    names = _names(term)
    if not names:
        return ""
    known = _known(states, names)
    texts = []
    for name in names:
        size = np.abs(known.get(name, np.zeros(1)))
        texts.append(recording_that_shows(name, float(np.min(size[size > 0], initial=np.inf)), float(np.max(size))))
    if isinstance(term.mechanism, ByTool):
        named = ", ".join(term.mechanism.tools)
        used = f"each of the tools {named}" if len(term.mechanism.tools) > 1 else f"tool {named} and with another"
        texts.append(f"the same program with {used}, also in the air")
    wanted = "; and ".join(dict.fromkeys(filter(None, texts)))
    if not wanted:
        return ""
    parts = [*_left_open(names, known), wanted + _why(names, term)]
    return ": ".join(parts) + _when(term, states)


def _names(term: Term) -> list[str]:
    """Signals that a law is a law of, and those that confine it; those first that take many values."""
    confined = (g.variable.strip("|").replace(PATH_SPEED, "feed") for g in term.gates)
    names = {*term.mechanism.reads, *confined}
    return sorted(names, key=lambda n: (QUANTITIES[n].unit == "–", n))


def _known(states: Sequence[AxisState], names: Iterable[str]) -> Mapping[str, Float1D]:
    """Signals by name in some rows of all parts, (m,) each: `names`, and those that may stand for them."""
    n = sum(len(s.time) for s in states)
    rows = np.unique(np.linspace(0, n - 1, min(n, _ROWS)).astype(int))
    every = common_signals(states, rows)
    return {name: v for name, (v, _) in every.items() if name in names or name.startswith(_OTHERS)}


def _left_open(names: Sequence[str], known: Mapping[str, Float1D]) -> list[str]:
    """What these data do not tell of the first of these signals: another one that goes with it, a direction."""
    said = []
    for name in names:
        values = known.get(name)
        if values is None or QUANTITIES[name].unit == "–":
            continue
        if name in _BOTH_WAYS and (values.min() >= 0 or values.max() <= 0):
            said.append(f"{the(name)} has one direction only in these data")
        others = {o: _goes_with(values, v) for o, v in known.items() if o not in names and o not in CLOCKS}
        nearest = max(others, key=lambda o: others[o], default=None)
        if nearest is not None and others[nearest] > _GOES_WITH:
            said.append(
                f"in these data {the(name)} goes with {the(nearest)} (correlation {others[nearest]:.2f}), and it may "
                "as well be the latter that counts"
            )
        break
    return ["; ".join(said)] if said else []


def _goes_with(a: Float1D, b: Float1D) -> float:
    """Correlation of two signals, or of their sizes."""
    with np.errstate(invalid="ignore", divide="ignore"):
        each = (np.corrcoef(a, b)[0, 1], np.corrcoef(np.abs(a), np.abs(b))[0, 1])
    return float(np.nanmax([0.0, abs(each[0]), each[1]]))


def _why(names: Sequence[str], term: Term) -> str:
    """What the recording is asked."""
    kinds = {"load" if n.startswith(_LOADS) else n for n in names}
    if len(kinds) > 1:
        return (
            ": what changes with one of them while the others stay is its own, and what only their product makes is not"
        )
    if "load" in kinds:
        return ": what is there without material is no process load"
    return ""


def _when(term: Term, states: Sequence[AxisState]) -> str:
    """How long, or how often per second, where the law has a time of its own."""
    shape = dict(term.shape)
    if isinstance(term.mechanism, Ringing) or "f" in shape:
        rate, needs = 1 / float(np.median([s.dt for s in states])), _PER_PERIOD * shape["f"]
        here = f"; these data have {rate:.3g}" if rate < needs else ""
        return f". It rings at {shape['f']:.3g} Hz: record at least {in_digits(needs)} samples per second{here}"
    if isinstance(term.mechanism, Behind) and shape["tau"] > _SLOW_S:
        late, hold = in_digits(shape["tau"]), in_digits(3 * shape["tau"])
        return f". It comes {late} s late: hold each for {hold} s, and rest as long after it"
    return ""
