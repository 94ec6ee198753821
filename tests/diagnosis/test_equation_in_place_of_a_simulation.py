"""Where no current was simulated, an equation fitted on the diagnosed parts is the simulation: what it follows from has
to be there in every part that it is used on."""

import numpy as np
import pyarrow.parquet as pq
import pytest
from click.testing import CliRunner

from pido.cli.correct import command as correct_command
from pido.cli.diagnose import command as diagnose_command
from pido.core.part import PartInfo
from pido.core.recording import Recording
from pido.diagnosis.baseline import equation_inputs
from pido.diagnosis.diagnose import diagnose
from pido.recordings.folder import write_folder

STEP, NOISE = 0.02, 0.03


def part(number, rows=1200):
    """x and y move, the tool cuts; the current of x is the equation's own and noise."""
    rng, t = np.random.default_rng(number), np.arange(rows) * STEP
    columns = {"time": t}
    for axis in "xy":
        v = np.convolve(np.repeat(rng.choice([-12.0, -5.0, 5.0, 12.0], rows // 50), 50), np.ones(9) / 9, "same")
        columns |= {f"pos_{axis}": np.cumsum(v) * STEP, f"v_{axis}": v, f"a_{axis}": np.gradient(v, t)}
    sign = np.sign(columns["v_x"])
    mrr = np.repeat(rng.uniform(20, 90, rows // 100), 100) * (np.arange(rows) % 300 > 60)
    force = 4.0 * mrr * sign
    current = 0.2 + 0.8 * sign + 3e-3 * columns["v_x"] ** 2 * sign + 4e-5 * force * mrr
    columns |= {"mrr_sim": mrr, "f_x_sim": force, "f_y_sim": 0.3 * force}
    columns["curr_x"] = current + rng.normal(0, NOISE, rows)
    return Recording(PartInfo(part=f"p{number}", machine="m", order=number), columns)


def without(recording, *names):
    return Recording(recording.part, {k: v for k, v in recording.columns.items() if k not in names})


@pytest.fixture(scope="module")
def diagnosis(tmp_path_factory):
    place = tmp_path_factory.mktemp("equation")
    folders = [write_folder(part(k), place / f"p{k}") for k in (1, 2, 3)]
    answer = CliRunner().invoke(diagnose_command, [*map(str, folders), "--out", str(place / "out")])
    assert answer.exit_code == 0, answer.output
    return place / "out"


@pytest.mark.parametrize(
    ("names", "says"),
    [
        (["mrr_sim"], "lacks mrr_sim, which the diagnosed parts had"),
        (["f_x_sim"], "lacks f_x_sim, which"),
        (["mrr_sim", "f_x_sim", "f_y_sim"], "lacks f_x_sim, mrr_sim, which"),
        (["v_x", "pos_x"], "lacks v_x, which"),
    ],
)
@pytest.mark.parametrize("how", ["gone", "empty"])
def test_a_part_that_lacks_what_the_equation_follows_from_is_refused(names, says, how, diagnosis, tmp_path):
    recording = part(4)
    empty = recording.with_columns(**dict.fromkeys(names, np.full(len(recording), np.nan)))
    folder = write_folder(without(recording, *names) if how == "gone" else empty, tmp_path / "p4")
    answer = CliRunner().invoke(correct_command, [str(diagnosis), str(folder), "--out", str(tmp_path / "c.parquet")])
    assert answer.exit_code == 1
    assert f"part p4: the equation on axis x cannot be applied: the part {says}" in str(answer.exception)
    assert not (tmp_path / "c.parquet").exists()


@pytest.mark.parametrize("names", [(), ("pos_x", "pos_y"), ("f_y_sim",), ("curr_x",)])
def test_a_part_with_all_that_the_equation_follows_from_is_corrected_to_the_noise(names, diagnosis, tmp_path):
    folder, out = write_folder(without(part(4), *names), tmp_path / "p4"), tmp_path / "c.parquet"
    answer = CliRunner().invoke(correct_command, [str(diagnosis), str(folder), "--out", str(out)])
    assert answer.exit_code == 0, answer.output
    left = part(4)["curr_x"] - pq.read_table(out)["curr_x_corrected"].to_numpy()
    assert np.std(left) == pytest.approx(NOISE, rel=0.1)


def test_an_equation_of_parts_that_lack_a_column_in_one_of_them_does_without_it_and_says_so():
    found = diagnose([part(1), without(part(2), "f_y_sim"), part(3)])
    names = found.model["axes"]["x"]["equation"]["names"]
    assert "f_y_sim" not in equation_inputs(names)
    assert "F_x MRR" in names
    assert [n for n in found.notes if "does without 'f_y_sim', which p2 lacks" in n]


def test_the_columns_of_a_term_are_those_in_its_name():
    assert equation_inputs(["a_x v_x sgn(v_x)", "1"]) == ("v_x", "a_x")
    assert equation_inputs(["M_sp MRR", "sgn(v_z)"]) == ("v_z", "m_sp_sim", "mrr_sim")
