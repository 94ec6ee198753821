"""Laws without a name that follow a clock, the place where a part was set up, or the tool in the spindle."""

from dataclasses import replace

import numpy as np
import pytest

from pido.core.errors import DiagnosisError
from pido.core.part import PartInfo, PartTool
from pido.core.recording import Recording
from pido.diagnosis.arms import Arm
from pido.diagnosis.formulas import Formula
from pido.diagnosis.models import AxisModel, _mechanism, as_json, axis_models
from pido.diagnosis.signals import common_signals, signals
from pido.diagnosis.state import axis_states
from pido.diagnosis.terms import fit
from pido.diagnosis.tools import ByTool
from pido.diagnosis.unnamed import with_unknown
from pido.diagnosis.waves import Wave
from tests.diagnosis.planted import NOISE, part, planted


def found(effect, change=lambda k, recording: recording, strength=2.0):
    """What the search without a name makes of an effect: state -> (n,), in five parts that are changed first."""
    library, noise = planted(effect, strength, count=5, change=change)
    (term,), _ = with_unknown(library, noise, [], 0)
    model = AxisModel("x", NOISE, (term,), (np.ones(len(term.mechanism.amplitudes)),))
    assert axis_models(as_json({"x": model}))["x"].terms == (term,)
    size = np.std(np.concatenate([effect(s) for s in library.mismatch.states]))
    return term, fit(library.mismatch, noise, [term]).amplitudes[0] * size / strength / NOISE


def columns_of(recording) -> dict:
    return {name: recording[name] for name in recording.columns}


def with_info(recording, **facts) -> Recording:
    info = PartInfo(part=recording.part.part, machine="m", order=recording.part.order, **facts)
    return Recording(info, columns_of(recording))


def began_at(k, recording) -> Recording:
    return with_info(recording, start_time_s=(0.0, 41.3, 90.1, 131.7, 300.4)[k])


def set_up_at(k, recording) -> Recording:
    """y begins 40 to 200 mm from where it was before."""
    return Recording(recording.part, columns_of(recording) | {"pos_y": recording["pos_y"] + (0, 130, 40, 200, 75)[k]})


def milled(k, recording) -> Recording:
    """Three tools, a third of each part each, in an order that differs from part to part."""
    tools = np.roll(["3", "8", "20"], k)
    third = len(recording) // 3
    which = np.repeat(tools, third).astype(float)
    return Recording(recording.part, columns_of(recording) | {"tool_id": np.resize(which, len(recording))})


def sawtooth(time):
    return (time / 2.6 % 1.0) - 0.5


def test_a_friction_that_oil_eases_in_pulses_repeats_on_the_clock_of_the_part():
    term, _ = found(lambda s: sawtooth(s.time) * np.sign(s.v))
    assert isinstance(term.mechanism, Wave)
    assert (term.mechanism.place, term.mechanism.signal) in {("t_part", "held_x"), ("t_part", "v_x")}
    assert term.mechanism.harmonics > 1
    assert dict(term.shape)["L"] == pytest.approx(2.6, rel=0.005)


def test_pulses_that_go_on_from_part_to_part_repeat_on_the_clock_of_the_machine():
    term, _ = found(lambda s: sawtooth(s.clock) * np.sign(s.v), began_at)
    assert isinstance(term.mechanism, Wave)
    assert term.mechanism.place == "uptime"
    assert dict(term.shape)["L"] == pytest.approx(2.6, rel=0.0005)


def test_a_load_on_an_arm_that_counts_from_where_the_part_was_set_up():
    def hose(state):
        return (state.places["y"] - state.places["y"][0] - 12.0) * state.v

    term, (by_itself, by_place) = found(hose, set_up_at)
    assert term.mechanism == Arm("from_y", "v_x", "mm/s")
    assert -by_itself / by_place == pytest.approx(12.0, rel=0.1)


def test_where_all_parts_begin_at_one_place_there_is_no_place_beside_it():
    anywhere = axis_states([set_up_at(k, part(k)) for k in range(2)], "x")
    assert {"pos_y", "from_y"} <= set(common_signals(anywhere))
    one = [replace(s, places={a: p - p[0] for a, p in s.places.items()}) for s in anywhere]
    assert {n for n in common_signals(one) if n.startswith("from_")} == set()
    np.testing.assert_allclose(signals(one[1], ["from_y"])["from_y"][0], one[1].places["y"])


MASS = Formula((("a_x", "u"),), "(mm/s²)")
SIZES = {"3": -0.8, "8": 0.1, "20": 1.3}


def by_tool(state):
    return np.array([SIZES[t] for t in state.tool_id]) * state.a


def test_a_mass_that_the_simulation_has_wrong_of_each_tool_is_one_law():
    term, sizes = found(by_tool, milled, strength=1.0)
    assert term.mechanism == ByTool(("20", "3", "8"), MASS)
    np.testing.assert_allclose(sizes, [1.3, -0.8, 0.1], atol=0.12)
    assert term.mechanism.conditions("x", {})[0].endswith("each of the tools 20, 3 and 8 has for itself")


def test_a_product_of_two_quantities_with_one_tool_alone_is_one_law():
    term, (size,) = found(lambda s: (s.tool_id == "8") * s.a * np.abs(s.others["y"].v), milled)
    law = term.mechanism
    assert isinstance(law, ByTool)
    assert (law.tools, law.reads) == (("8",), {"a_x", "v_y"})
    assert size == pytest.approx(1.0, rel=0.2)
    assert law.conditions("x", {})[0].endswith("while tool 8 is in the spindle")


def test_a_model_of_before_has_one_quantity_for_each_tool():
    own = {"tools": ["3", "8"], "carries": "a_x", "unit": "mm/s²", "form": "u"}
    assert _mechanism(own) == ByTool(("3", "8"), MASS)


def test_a_tool_that_no_other_part_had_says_nothing():
    def one_is_alone(k, recording):
        changed = milled(k, recording)
        tools = changed["tool_id"]
        return Recording(changed.part, columns_of(changed) | {"tool_id": np.where((tools == 3) & (k > 0), 8.0, tools)})

    term, _ = found(by_tool, one_is_alone)
    assert isinstance(term.mechanism, ByTool)
    assert term.mechanism.tools == ("20", "8")
    alone = axis_states([one_is_alone(0, part(0))], "x")[0]
    assert not term.of_part(alone)[:, alone.tool_id == "3"].any()


def test_a_part_that_does_not_say_its_tool_is_refused_and_the_only_tool_of_a_part_is_known():
    law = ByTool(("3", "8"), MASS)
    (silent,) = axis_states([part(0)], "x")
    with pytest.raises(DiagnosisError, match=r"part p0: .* does not say which tool .* tool_id"):
        law.regressors(silent)
    (only,) = axis_states([with_info(part(0), tools={"8": PartTool(diameter_mm=6.0)})], "x")
    np.testing.assert_array_equal(law.regressors(only)[:, 1], signals(only)["a_x"][0])


@pytest.mark.parametrize(
    "column", [np.array([None, None, "3", "8"], object), np.array([np.nan, np.nan, 3.0, 8.0]), ["", "", 3.0, "8"]]
)
def test_an_empty_cell_says_no_tool(column):
    moving = np.array([0.0, 1.0, 2.0, 1.0])
    columns = {"time": np.arange(4) * 0.02, "v_x": moving, "a_x": moving, "curr_x": moving}
    column = np.asarray(column, object) if isinstance(column, list) else column
    (state,) = axis_states([Recording(PartInfo(part="p", machine="m"), columns | {"tool_id": column})], "x")
    assert list(state.tool_id) == ["", "", "3", "8"]
