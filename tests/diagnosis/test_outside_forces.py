"""A force that is tied to times and to nothing recorded: said of its parts, never passed over in silence on others."""

import json
from itertools import pairwise

import numpy as np
import pytest
from click.testing import CliRunner

from pido.cli import pido
from pido.core.part import PartInfo
from pido.core.recording import Recording
from pido.diagnosis.answers import to_record, where_of
from pido.diagnosis.contract import MODEL_SCHEMA
from pido.diagnosis.correct import correct, not_applied
from pido.diagnosis.events import ExternalForce, Rhythm
from pido.diagnosis.locate import rhythm
from pido.diagnosis.models import AxisModel, as_json, known_of
from pido.diagnosis.pulses import Pulses
from pido.diagnosis.state import axis_states
from pido.diagnosis.terms import Term
from pido.recordings.folder import write_folder

EVERY, LASTS = 40.0, 8.0


def part(name, seconds=200.0):
    t = np.arange(0.0, seconds, 0.02)
    v = 10 * np.sin(t)
    columns = {"time": t, "v_z": v, "a_z": np.gradient(v, t), "pos_z": np.cumsum(v) * 0.02, "curr_z_sim": 0.1 * v}
    return Recording(PartInfo(part=name, machine="m"), columns)


def forced(*starts):
    parts = [part(f"p{k}") for k in range(len(starts))]
    intervals = [(p.part.part, t, t + LASTS) for p, own in zip(parts, starts, strict=True) for t in own]
    return Term(ExternalForce(tuple(intervals))), parts


def where(term, parts):
    states = axis_states(parts, "z")
    effect = 0.3 * np.sum(term.columns(states), axis=0)
    edges = np.cumsum([0, *(len(p) for p in parts)])
    assert all(effect[i:j].any() for i, j in pairwise(edges))
    return where_of(states, term, effect, edges, 0.05)


def model_of(term, parts):
    amplitudes = np.full(len(term.mechanism.amplitudes), 0.3)
    own = AxisModel("z", 0.1, (term,), (amplitudes,), known=known_of(axis_states(parts, "z")))
    return as_json({"z": own}) | {"parts": [p.part.part for p in parts], "orders": [1, 2]}


def test_a_force_with_a_rhythm_is_asked_for_among_what_switches_with_it():
    term, parts = forced((5, 45, 85, 125), (20, 60, 100, 140))
    place = where(term, parts)
    assert "it comes again every 40 s" in place.summary
    assert "it predicts no other part" in place.summary
    asked = to_record(term, rhythm(place.intervals))
    for wanted in ("40 s", "lubrication pump", "hydraulic unit", "chip conveyor", "coolant pump", "signal"):
        assert wanted in asked
    wave = to_record(Term(Rhythm(clock=False), (("T", EVERY),)), None)
    assert wave == asked


def test_a_force_without_a_rhythm_is_asked_for_too_and_no_rhythm_is_invented():
    term, parts = forced((5, 31, 140), (20, 90, 110))
    place = where(term, parts)
    assert "every" not in place.summary
    assert "it predicts no other part" in place.summary
    assert "same program twice" in to_record(term, rhythm(place.intervals))


@pytest.mark.parametrize("every", [EVERY, None])
def test_coolant_that_is_recorded_is_not_asked_for(every):
    term, _ = forced((5, 45), (20, 60))
    assert "coolant pump" in to_record(term, every)
    asked = to_record(term, every, coolant=True)
    assert "coolant" not in asked
    assert "chip conveyor)" in asked


@pytest.mark.parametrize("columns", [{}, {"coolant": 0.0}])
def test_pulses_ask_for_coolant_where_no_part_says_when_it_is_on(columns):
    made = [
        Recording(p.part, p.columns | {k: v + 0 * p.time for k, v in columns.items()}) for p in (part("p0"), part("p1"))
    ]
    told = Pulses(clock=False).told(axis_states(made, "z"), {"T": EVERY, "t_0": 0.0, "w": LASTS}, {})
    assert ("coolant" in told.to_record) == (not columns)


def test_every_force_has_an_interval_of_its_own_in_the_order_of_the_forces():
    parts = [part("p0"), part("p1")]
    # As they are found: one within another, one far smaller than the rest, and not in the order of time.
    intervals = (("p1", 60.0, 68.0), ("p0", 5.0, 25.0), ("p0", 12.0, 25.0), ("p1", 20.0, 28.0))
    term, sizes = Term(ExternalForce(intervals)), np.array([0.3, -0.3, 0.02, 0.01])
    states, edges = axis_states(parts, "z"), np.cumsum([0, *(len(p) for p in parts)])
    found = where_of(states, term, sizes @ term.columns(states), edges, 0.05).intervals
    assert [(i.part, i.t_start) for i in found] == [(p, start) for p, start, _ in intervals]
    assert [i.t_end for i in found] == pytest.approx([end for *_, end in intervals], abs=0.021)
    assert found[0].score > 0.9 > 0.2 > found[3].score
    assert "every" not in where_of(states, term, sizes @ term.columns(states), edges, 0.05).summary


def test_correct_names_the_force_on_another_part_and_not_on_its_own():
    term, parts = forced((5, 45), (20, 60))
    model = model_of(term, parts)
    other = part("p7")
    assert not correct(model, other).mismatch["z"].any()
    assert not_applied(model, other) == ["z: external_force"]
    assert not_applied(model, parts[0]) == []
    silent = Term(ExternalForce((("p0", 5.0, 13.0),)))  # p1 was diagnosed, and there it was not
    assert not_applied(model_of(silent, parts), parts[1]) == []


@pytest.mark.parametrize(("name", "said"), [("p7", True), ("p0", False)])
def test_the_command_says_what_it_left_out_and_why(tmp_path, name, said):
    term, parts = forced((5, 45), (20, 60))
    folder = tmp_path / "diagnosis"
    folder.mkdir()
    (folder / "model.json").write_text(json.dumps({"schema": MODEL_SCHEMA, **model_of(term, parts)}))
    source = write_folder(part(name), tmp_path / name)
    done = CliRunner().invoke(pido, ["correct", str(folder), str(source), "--out", str(tmp_path / "out.parquet")])
    assert done.exit_code == 0, done.output
    assert ("z: external_force is not applied" in done.stderr) == said
    assert ("predicts no other part" in done.stderr) == said
