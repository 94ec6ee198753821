"""An axis that goes to and fro at many feeds with stops, against a simulation of its friction and inertia."""

import numpy as np

from pido.core.part import PartInfo
from pido.core.recording import Recording
from pido.diagnosis.mechanisms import CATALOGUE
from pido.diagnosis.mismatch import Mismatch, lay_out
from pido.diagnosis.state import axis_states
from pido.diagnosis.whiten import Noise

NOISE = 0.02
BY_ID = {m.id: m for m in CATALOGUE}


def recordings(count=3, rows=2000):
    """x goes to and fro at many feeds with stops; the spindle changes its speed. One sample in 0.02 s."""
    for k in range(count):
        rng = np.random.default_rng(k)
        t = np.arange(rows) * 0.02
        v = np.repeat(rng.choice([0.0, 0.4, 1.5, 5.0, 12.0], rows // 40) * rng.choice([-1, 1], rows // 40), 40)
        v = np.convolve(v, np.hanning(11)[1:-1] / np.hanning(11).sum(), "same")
        v_sp = np.convolve(np.repeat(rng.choice([6e3, 1.2e4, 2.4e4], rows // 200), 200), np.ones(50) / 50, "same")
        columns = {
            "time": t, "v_x": v, "pos_x": np.cumsum(v) * 0.02, "a_x": np.gradient(v, t),
            "v_sp": v_sp, "a_sp": np.gradient(v_sp, t),
            "curr_x_sim": 0.5 * np.sign(np.where(np.abs(v) > 0.02, v, 0)) + 0.004 * np.gradient(v, t),
            "curr_sp_sim": 4e-9 * v_sp**2 + 2e-4 * np.gradient(v_sp, t),
        }  # fmt: skip
        yield Recording(PartInfo(part=f"p{k}", machine="m", order=k + 1, start_time_s=100.0 * k), columns)


def laid_out(effect, axis="x") -> tuple[Mismatch, Noise]:
    """effect : state -> (n,), A, beside white noise; and that noise as it is."""
    rng = np.random.default_rng(5)
    states = axis_states(list(recordings()), axis)
    mismatch = lay_out(states, [effect(s) + rng.normal(0, NOISE, len(s.time)) for s in states])
    return mismatch, Noise(np.zeros(0), np.full(mismatch.n, NOISE), 1.0, mismatch.usable)
