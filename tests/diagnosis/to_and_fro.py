"""An axis that goes to and fro at feeds of its own, an effect in white noise on it, and a library beside."""

import numpy as np

from pido.core.part import PartInfo
from pido.core.recording import Recording
from pido.diagnosis.library import Library
from pido.diagnosis.mismatch import Mismatch, lay_out
from pido.diagnosis.state import axis_states
from pido.diagnosis.terms import Term
from pido.diagnosis.whiten import Noise
from tests.diagnosis.planted import NOISE, VISCOUS, white


def recordings(count=3, rows=1500):
    """x and y go to and fro at feeds of their own; one sample in 0.02 s."""
    for k in range(count):
        rng = np.random.default_rng(k)
        t = np.arange(rows) * 0.02
        columns = {"time": t}
        for axis in "xy":
            v = np.convolve(np.repeat(rng.uniform(-12, 12, rows // 25), 25), np.ones(7) / 7, "same")
            columns |= {f"v_{axis}": v, f"pos_{axis}": np.cumsum(v) * 0.02, f"a_{axis}": np.gradient(v, t)}
        yield Recording(PartInfo(part=f"p{k}", machine="m", order=k + 1, start_time_s=100.0 * k), columns)


def laid_out(effect, seed=0) -> tuple[Mismatch, Noise]:
    """effect : state -> (n,), A, beside white noise; and that noise as it is."""
    states = axis_states(list(recordings()), "x")
    rng = np.random.default_rng(seed)
    mismatch = lay_out(states, [effect(s) + rng.normal(0, NOISE, len(s.time)) for s in states])
    return mismatch, white(mismatch)


def library_of(mismatch, noise, *terms):
    library = Library(mismatch, terms or [Term(VISCOUS)])
    library.whiten(noise)
    return library


def nothing(state):
    return np.zeros(len(state.time))
