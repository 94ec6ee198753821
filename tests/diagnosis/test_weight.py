"""A constant on a vertical axis: the axis' weight in the simulation, a tool's weight that is not, a sensor's zero."""

from dataclasses import replace

import numpy as np
import pytest

from pido.core.part import PartInfo
from pido.core.recording import Recording
from pido.diagnosis.library import Library
from pido.diagnosis.mismatch import lay_out
from pido.diagnosis.search import first_look, search, sensor_or_weight
from pido.diagnosis.state import axis_states

NOISE, WEIGHT = 0.02, 4.0


def recordings(count=3, rows=1500, weight=WEIGHT):
    """A vertical axis goes up and down with two tools, and stands; the simulation has its weight and its friction."""
    for k in range(count):
        rng = np.random.default_rng(k)
        t = np.arange(rows) * 0.02
        v = np.convolve(np.repeat(rng.choice([-9.0, -4.0, 0.0, 4.0, 9.0], rows // 25), 25), np.ones(7) / 7, "same")
        about = {
            "part": f"p{k}", "machine": "m", "order": k + 1, "vertical_axis": "z",
            "tools": {"1": {"mass_kg": 1.0}, "2": {"mass_kg": 3.0}},
            "tool_changes": [{"t": 0.0, "tool_id": 1}, {"t": float(t[rows // 3 + 90 * k]), "tool_id": 2}],
        }  # fmt: skip
        columns = {
            "time": t, "pos_z": np.cumsum(v) * 0.02, "v_z": v, "a_z": np.gradient(v, t),
            "curr_z_sim": weight + 0.5 * np.sign(v) + 0.02 * v + 0.004 * np.gradient(v, t),
        }  # fmt: skip
        yield Recording(PartInfo.model_validate(about), columns)


@pytest.mark.parametrize(
    ("missing", "name"),
    [
        (lambda s: 0.01 * s.tool_mass, "gravity_load"),
        (lambda s: np.full(len(s.time), 0.02), "sensor_offset"),
        (lambda s: np.full(len(s.time), 0.1 * WEIGHT), "miscalibrated:gravity_load"),
    ],
    ids=["a tool's weight", "a sensor's zero", "a wrong weight"],
)
def test_what_a_vertical_axis_draws_at_all_times_is_named_for_what_it_follows(missing, name):
    states = axis_states(list(recordings()), "z")
    rng = np.random.default_rng(7)
    mismatch = lay_out(states, [missing(s) + rng.normal(0, NOISE, len(s.time)) for s in states])
    answer = search(first_look(mismatch, rng), 1, False, rng)
    assert [t.name for t in answer.terms] == [name]


def test_what_changes_a_little_with_the_tool_beside_a_large_constant_is_not_the_simulated_weight():
    def cut(state):
        return 0.1 * state.moving * (state.tool_mass > 2)

    states = [replace(s, sim=s.sim + cut(s)) for s in axis_states(list(recordings()), "z")]
    rng = np.random.default_rng(7)
    mismatch = lay_out(states, [0.01 * s.tool_mass + rng.normal(0, NOISE, len(s.time)) for s in states])
    look = first_look(mismatch, rng)
    assert dict(look.inside["gravity_load"].term.shape) == {"by_tool": 0.0}
    assert [t.name for t in search(look, 1, False, rng).terms] == ["gravity_load"]


@pytest.mark.parametrize("chosen", ["sensor_offset", "gravity_load"])
def test_a_constant_on_a_vertical_axis_without_a_simulated_weight_is_the_weight_whichever_was_chosen(chosen):
    states = axis_states(list(recordings(weight=0.0)), "z")
    rng = np.random.default_rng(7)
    mismatch = lay_out(states, [0.1 * WEIGHT + rng.normal(0, NOISE, len(s.time)) for s in states])
    look = first_look(mismatch, rng)
    assert "gravity_load" not in look.inside
    library = Library(mismatch, look.offered)
    library.whiten(look.noise)
    constant = next(t for t in library.terms if t.name == chosen)
    assert [t.name for t in sensor_or_weight(library, look.noise, [constant], look.inside)] == ["gravity_load"]
