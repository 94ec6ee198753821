"""A part that goes beyond what a finding was fitted on: it is said of which quantity, how far, and of how many rows."""

import json
import re
import shutil

import numpy as np
import pyarrow.parquet as pq
import pytest
from click.testing import CliRunner

from pido.cli.correct import command as correct_command
from pido.cli.diagnose import command as diagnose_command
from pido.core.part import PartInfo
from pido.core.recording import Recording
from pido.diagnosis.arms import Arm
from pido.diagnosis.beyond import beyond, longer_pauses, ranges
from pido.diagnosis.formulas import Formula
from pido.diagnosis.gates import Gate
from pido.diagnosis.mechanisms import CATALOGUE
from pido.diagnosis.models import AxisModel, as_json, axis_models
from pido.diagnosis.state import axis_states
from pido.diagnosis.terms import Term
from pido.recordings.folder import write_folder

STEP, FASTEST, FRICTION = 0.02, 12.0, 0.03
BY_ID = {m.id: m for m in CATALOGUE}


def part(number, fastest=FASTEST, share=1.0, rows=2400):
    """x lacks viscous friction in its simulation. fastest : mm/s, that it goes in this share of the moves, in the last
    of them."""
    rng, t = np.random.default_rng(number), np.arange(rows) * STEP
    moves = rng.choice([-FASTEST, -5.0, 5.0, FASTEST], rows // 50)
    moves[round(len(moves) * (1 - share)) :] *= fastest / FASTEST
    v = np.convolve(np.repeat(moves, 50), np.ones(9) / 9, "same")
    sim = 0.5 * np.sign(v)
    columns = {
        "time": t, "pos_x": np.cumsum(v) * STEP, "v_x": v, "a_x": np.gradient(v, t), "curr_x_sim": sim,
        "curr_x": sim + FRICTION * v + rng.normal(0, 0.03, rows),
    }  # fmt: skip
    return Recording(PartInfo(part=f"p{number}", machine="m", order=number), columns)


@pytest.fixture(scope="module")
def diagnosed(tmp_path_factory):
    place = tmp_path_factory.mktemp("beyond")
    folders = [write_folder(part(k), place / f"p{k}") for k in (1, 2, 3)]
    answer = CliRunner().invoke(diagnose_command, [*map(str, folders), "--out", str(place / "out")])
    assert answer.exit_code == 0, answer.output
    assert "viscous_friction" in answer.output
    return place / "out"


def corrected(diagnosis, recording, place):
    """What was said, and what stands in the file."""
    folder, out = write_folder(recording, place / recording.part.part), place / "out.parquet"
    answer = CliRunner().invoke(correct_command, [str(diagnosis), str(folder), "--out", str(out)])
    assert answer.exit_code == 0, answer.output
    about = pq.read_schema(out).metadata or {}
    return answer.stderr, json.loads(about.get(b"pido.notes", b"[]")), pq.read_table(out)


def test_speeds_beyond_those_of_the_diagnosed_parts_are_said_and_kept_in_the_file(diagnosed, tmp_path):
    new = part(4, fastest=40.0, share=0.25)
    said, notes, table = corrected(diagnosed, new, tmp_path)
    (line,) = [note for note in notes if "viscous_friction" in note]
    assert line in said
    assert "the speed of the x axis from -12 to 12 mm/s" in line
    (percent,) = re.findall(r"(\d+) % of the rows", line)
    assert float(percent) == pytest.approx(100 * np.mean(np.abs(new["v_x"]) > 1.05 * 12), abs=1.0)
    assert "-40 mm/s and 40 mm/s" in line
    assert table.column_names == [
        "time",
        "mismatch_x",
        "mismatch_score_x",
        "curr_x_corrected",
    ]  # the contract


def test_a_part_like_the_diagnosed_ones_is_corrected_without_a_word(diagnosed, tmp_path):
    said, notes, _ = corrected(diagnosed, part(5), tmp_path)
    assert not said
    assert notes == []


def test_a_model_of_before_still_corrects(diagnosed, tmp_path):
    former = shutil.copytree(diagnosed, tmp_path / "former")
    model = json.loads((former / "model.json").read_text())
    for term in model["axes"]["x"]["terms"]:
        del term["seen"]
    (former / "model.json").write_text(json.dumps(model))
    said, notes, _ = corrected(former, part(4, fastest=40.0), tmp_path)
    assert "extrapolated" not in said
    assert notes == []


def test_an_equation_in_place_of_a_simulation_is_known_as_far_as_its_columns_went(tmp_path):
    def bare(*how, **more):
        made = part(*how, **more)
        return Recording(made.part, {n: v for n, v in made.columns.items() if n != "curr_x_sim"})

    folders = [write_folder(bare(k), tmp_path / f"p{k}") for k in (1, 2, 3)]
    answer = CliRunner().invoke(diagnose_command, [*map(str, folders), "--out", str(tmp_path / "out")])
    assert answer.exit_code == 0, answer.output
    _, notes, _ = corrected(tmp_path / "out", bare(4, fastest=40.0), tmp_path)
    (line,) = [note for note in notes if "the equation" in note and "speed" in note]
    assert "the speed of the x axis from -12 to 12 mm/s" in line
    _, notes, _ = corrected(tmp_path / "out", bare(5), tmp_path)
    assert not any("beyond" in note for note in notes)


def loaded(number=1, force=100.0, place=0.0, accelerating=1.0):
    t = np.arange(2000) * STEP
    columns = {"time": t, "pos_x": place + 30 * np.sin(t), "v_x": 30 * np.cos(t)}
    columns |= {"a_x": -30 * accelerating * np.sin(t), "pos_y": 20 * np.sin(0.6 * t), "v_y": 12 * np.cos(0.6 * t)}
    columns |= {"a_y": -7 * np.sin(0.6 * t), "f_x_sim": force * np.sin(t) ** 2, "mrr_sim": 50 * np.sin(t) ** 2}
    return Recording(PartInfo(part=f"p{number}", machine="m"), columns | {"curr_x_sim": 0.1 * np.cos(t)})


@pytest.mark.parametrize(
    ("term", "change", "signal", "ends"),
    [
        (Term(BY_ID["cutting_force"]), {"force": 300.0}, "f_x", (0.0, 100.0)),
        (Term(BY_ID["inertia"]), {"accelerating": 3.0}, "a_x", (-30.0, 30.0)),
        (Term(BY_ID["torque_ripple"], (("L", 10.0), ("late", 0.0))), {"place": 50.0}, "pos_x", (-30.0, 30.0)),
        (Term(Formula((("f_x", "u"), ("v_x", "u")), "(N)")), {"force": 300.0}, "f_x", (0.0, 100.0)),
        (Term(Arm("pos_x", "v_x", "mm/s")), {"place": -50.0}, "pos_x", (-30.0, 30.0)),
        (Term(BY_ID["inertia"], gates=(Gate("v_x", low=0.0),)), {"accelerating": 3.0}, "a_x", (-30.0, 30.0)),
    ],
    ids=lambda v: v.name if isinstance(v, Term) else "",
)
def test_forces_accelerations_and_places_have_their_ranges(term, change, signal, ends):
    (state,) = axis_states([loaded()], "x")
    seen = ranges(term, [state], np.ones(len(state.time), bool))
    assert seen[signal] == pytest.approx(ends, abs=0.1)
    model = as_json({"x": AxisModel("x", 0.1, (term,), (np.ones(len(term.mechanism.amplitudes)),), seen=(seen,))})
    assert axis_models(json.loads(json.dumps(model)))["x"].seen == (seen,)
    assert beyond(model, loaded(2)) == []
    found = {b.signal: b for b in beyond(model, loaded(2, **change))}
    assert signal in found
    assert (found[signal].axis, found[signal].mechanism) == ("x", term.name)
    assert 0.2 < found[signal].share < 0.9


def test_only_rows_that_were_fitted_count():
    (state,) = axis_states([loaded()], "x")
    usable = np.abs(state.v) < 15.0
    assert ranges(Term(BY_ID["viscous_friction"]), [state], usable)["v_x"] == pytest.approx((-15.0, 15.0), abs=0.5)


def started(name, start):
    made = loaded()
    return Recording(PartInfo(part=name, machine="m", start_time_s=start), made.columns)


DRIFT = (("tau", 300.0), ("along", 0.0), ("rises", 1.0), ("rest", 0.0))


@pytest.mark.parametrize(
    ("clock", "start", "between", "told"),
    [
        (1.0, 1300.0, None, (1160.02, 100.02)),  # of 40 s each, with 100 s between
        (2.0, 1300.0, None, (1160.02, 100.02)),
        (2.0, 260.0, None, None),
        (2.0, 1300.0, 1200.0, None),  # the pause is the one after the part between
        (0.0, 1300.0, None, None),  # every part starts cold
        (2.0, None, None, None),
        (2.0, 0.0, None, None),  # before them
    ],
)
def test_a_pause_longer_than_any_that_a_drift_was_fitted_on_is_said(clock, start, between, told):
    drift = Term(BY_ID["thermal_drift"], (("clock", clock), *DRIFT))
    model = as_json({"z": AxisModel("z", 0.1, (drift,), (np.ones(1),))})
    model |= {"history": [[-40.0, -0.02], [100.0, 139.98]], "parts": ["p0", "p1"]}
    earlier = [] if between is None else [started("p2", between)]
    found = longer_pauses(model, started("p3", start), earlier)
    assert found == ({} if told is None else {"z": pytest.approx(told, abs=0.1)})
