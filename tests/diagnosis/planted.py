"""An effect planted in white noise on an axis that goes to and fro, and what the search without a name makes of it."""

import numpy as np

from pido.core.part import PartInfo
from pido.core.recording import Recording
from pido.diagnosis.library import Library
from pido.diagnosis.mechanisms import CATALOGUE
from pido.diagnosis.mismatch import Mismatch, lay_out
from pido.diagnosis.state import axis_states
from pido.diagnosis.terms import Term
from pido.diagnosis.unnamed import with_unknown
from pido.diagnosis.whiten import Noise

NOISE = 0.05
STEP = 0.01
VISCOUS = next(m for m in CATALOGUE if m.id == "viscous_friction")


def part(k, rows=3000, stops=False):
    """x and y go to and fro in ramps of their own; with stops, a third of the time they stand."""
    rng = np.random.default_rng(k)
    t = np.arange(rows) * STEP
    columns = {"time": t}
    for axis in "xy":
        speeds = rng.uniform(-12, 12, rows // 50) * (rng.random(rows // 50) > 0.35 if stops else 1)
        v = np.convolve(np.repeat(speeds, 50), np.ones(9) / 9, "same")
        v = np.where(np.abs(v) < 1e-9, 0.0, v)
        columns |= {f"v_{axis}": v, f"pos_{axis}": np.cumsum(v) * STEP, f"a_{axis}": np.gradient(v, t)}
    return Recording(PartInfo(part=f"p{k}", machine="m", order=k + 1), columns)


def white(mismatch: Mismatch) -> Noise:
    return Noise(np.zeros(0), np.full(mismatch.n, NOISE), 1.0, mismatch.usable)


def planted(effect, strength=2.0, count=3, change=lambda k, recording: recording, **how):
    """A library of viscous friction, and white noise, over an effect: state -> (n,), A, in parts changed first;
    strength : times the noise."""
    states = axis_states([change(k, part(k, **how)) for k in range(count)], "x")
    effects = [effect(s) for s in states]
    size = np.std(np.concatenate(effects))
    rng = np.random.default_rng(0)
    mismatch = lay_out(states, [strength * NOISE / size * e + rng.normal(0, NOISE, len(e)) for e in effects])
    noise = white(mismatch)
    library = Library(mismatch, [Term(VISCOUS)])
    library.whiten(noise)
    return library, noise


def found_in(effect, **how):
    """What the search without a name makes of it."""
    (term,), _ = with_unknown(*planted(effect, **how), [], 0)
    return term
