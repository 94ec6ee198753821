"""What the diagnosed parts left behind is there when another part is corrected: the wear of a tool, a warm machine."""

import json
import shutil
from dataclasses import replace

import numpy as np
import pyarrow.parquet as pq
import pytest
from click.testing import CliRunner

from pido.cli.correct import command as correct_command
from pido.cli.diagnose import command as diagnose_command
from pido.core.part import PartInfo
from pido.core.recording import Recording
from pido.diagnosis.correct import correct
from pido.diagnosis.diagnose import diagnose
from pido.diagnosis.mechanisms import CATALOGUE
from pido.diagnosis.models import AxisModel, as_json
from pido.diagnosis.state import axis_states, worn_before
from pido.diagnosis.terms import Term
from pido.recordings.folder import write_folder

STEP = 0.02
PER_N = 2e-3  # A per N and cm³ that the edge has cut
ABOUT = {"tools": {"1": {"diameter_mm": 10.0, "teeth": 4}}, "tool_changes": [{"t": 0.0, "tool_id": "1"}]}


def worn_parts(count=4, rows=1200):
    """x draws more and more current for the same force, while one tool cuts all parts; with it, what it draws more."""
    volume = 0.0
    for k in range(1, count + 1):
        rng, t = np.random.default_rng(k), np.arange(rows) * STEP
        v = np.convolve(np.repeat(rng.choice([-12.0, -5.0, 5.0, 12.0], rows // 50), 50), np.ones(9) / 9, "same")
        mrr = np.repeat(rng.uniform(20, 90, rows // 100), 100) * (np.arange(rows) % 300 > 60)
        cut = volume + np.cumsum(mrr * np.r_[0.0, np.diff(t)])
        volume, force = cut[-1], 4.0 * mrr
        wear = PER_N * cut / 1000 * force
        simulated = 0.5 * np.sign(v) + 4e-3 * force
        columns = {
            "time": t, "pos_x": np.cumsum(v) * STEP, "v_x": v, "a_x": np.gradient(v, t), "mrr_sim": mrr,
            "f_x_sim": force, "curr_x_sim": simulated, "curr_x": simulated + wear + rng.normal(0, 0.03, rows),
        }  # fmt: skip
        about = {"part": f"p{k}", "machine": "m", "order": k, "start_time_s": 300.0 * k, **ABOUT}
        yield Recording(PartInfo.model_validate(about), columns), wear


@pytest.fixture(scope="module")
def diagnosed(tmp_path_factory):
    """Diagnosis of the first three of four parts, the parts, and what wear does to each."""
    place = tmp_path_factory.mktemp("worn")
    made = list(worn_parts())
    folders = [write_folder(recording, place / recording.part.part) for recording, _ in made]
    answer = CliRunner().invoke(diagnose_command, [*map(str, folders[:3]), "--out", str(place / "out")])
    assert answer.exit_code == 0, answer.output
    assert "tool_wear" in answer.output
    return place / "out", folders, [wear for _, wear in made]


def corrected(diagnosis, part, out, *after):
    """What was said, and the mismatch of x."""
    words = [str(diagnosis), str(part), *(w for p in after for w in ("--after", str(p))), "--out", str(out)]
    answer = CliRunner().invoke(correct_command, words)
    assert answer.exit_code == 0, answer.output
    return answer.stderr, pq.read_table(out)["mismatch_x"].to_numpy()


@pytest.mark.parametrize("after", [(), (0, 1, 2), (2,)])
@pytest.mark.parametrize("which", [0, 2, 3])
def test_a_part_is_corrected_by_the_wear_of_all_parts_before_it_once(which, after, diagnosed, tmp_path):
    diagnosis, folders, wear = diagnosed
    after = [folders[k] for k in after if k != which]
    said, mismatch = corrected(diagnosis, folders[which], tmp_path / "c.parquet", *after)
    assert said == ""
    np.testing.assert_allclose(mismatch, wear[which], atol=0.02 * wear[3].max())


def test_a_diagnosed_part_is_corrected_as_in_its_diagnosis(diagnosed, tmp_path):
    diagnosis, folders, _ = diagnosed
    for k in range(3):
        _, mismatch = corrected(diagnosis, folders[k], tmp_path / "c.parquet")
        series = pq.read_table(diagnosis / "parts" / f"p{k + 1}.parquet")
        np.testing.assert_allclose(mismatch, series["mismatch_x"].to_numpy(), atol=1e-9)


def test_a_diagnosis_of_before_says_that_it_does_not_know_the_wear_of_its_parts(diagnosed, tmp_path):
    diagnosis, folders, wear = diagnosed
    old = tmp_path / "old"
    shutil.copytree(diagnosis, old)
    model = json.loads((old / "model.json").read_text())
    (old / "model.json").write_text(json.dumps({k: v for k, v in model.items() if k not in ("worn", "parts")}))
    said, _ = corrected(old, folders[3], tmp_path / "c.parquet")
    assert "did not keep what its own parts wore off" in said
    said, mismatch = corrected(old, folders[3], tmp_path / "c.parquet", *folders[:3])
    assert said == ""
    np.testing.assert_allclose(mismatch, wear[3], atol=0.02 * wear[3].max())


@pytest.mark.parametrize(("after", "twice"), [((3,), "p4"), ((2, 2), "p3"), ((2, 3, 2), "p3, p4")])
def test_a_part_that_is_given_twice_is_refused(after, twice, diagnosed, tmp_path):
    diagnosis, folders, _ = diagnosed
    more = [word for k in after for word in ("--after", str(folders[k]))]
    words = [str(diagnosis), str(folders[3]), *more, "--out", str(tmp_path / "c.parquet")]
    answer = CliRunner().invoke(correct_command, words)
    assert answer.exit_code == 1
    assert str(answer.exception).startswith(f"part {twice} was given more than once")
    assert not (tmp_path / "c.parquet").exists()


BY_ID = {m.id: m for m in CATALOGUE}
WEAR = Term(BY_ID["tool_wear"], (("by", 0.0), ("of", 1.0)))


@pytest.mark.parametrize(
    ("about", "before"),
    [
        ({"order": 9}, 2),
        ({"order": 3}, 1),
        ({"order": 1}, 0),
        ({"start_time_s": 300.0}, 1),
        ({}, 2),
        ({"order": 9, "tools": {"1": {"used_before": {"cut_volume_mm3": 0.0, "cut_time_s": 0.0}}}}, 0),
    ],
)
def test_wear_is_that_of_the_parts_made_before_or_what_the_part_states(about, before):
    """The diagnosed parts are the second and the fourth of the day."""
    made = [recording for recording, _ in worn_parts(3)]
    diagnosed = [
        with_info(r, part=f"p{k}", order=k, start_time_s=100.0 * k) for k, r in zip((2, 4), made, strict=False)
    ]
    model = as_json({"x": AxisModel("x", 0.1, (WEAR,), (np.ones(1),))}) | {
        "parts": ["p2", "p4"], "orders": [2, 4], "worn": worn_before(diagnosed),
        "history": [[200.0, 223.98], [400.0, 423.98]],
    }  # fmt: skip
    removed = [float(np.sum(r["mrr_sim"] * STEP)) for r in made]
    mismatch = correct(model, with_info(made[2], part="other", **about)).mismatch["x"]
    assert mismatch[-1] == pytest.approx(sum([*removed[:before], removed[2]]) / 1000, rel=1e-3)


def with_info(recording, **about):
    return replace(recording, part=PartInfo.model_validate({"machine": "m", **ABOUT, **about}))


@pytest.fixture(scope="module")
def warming():
    """Four parts of 30 s, ten seconds after one another, of a machine that warms up: what heat does to each, and all in
    a time that does not begin at zero."""
    made, wants = [], []
    for k in range(4):
        rng, t = np.random.default_rng(k), np.arange(1500) * STEP
        v = np.convolve(np.repeat(rng.choice([-12.0, -5.0, 5.0, 12.0], 30), 50), np.ones(9) / 9, "same")
        heat = 0.5 * np.exp(-(40.0 * k + t) / 60.0)
        columns = {"time": t + 15.0, "pos_x": np.cumsum(v) * STEP, "v_x": v, "a_x": np.gradient(v, t)}
        columns |= {"curr_x_sim": np.sign(v), "curr_x": np.sign(v) + heat + rng.normal(0, 0.03, 1500)}
        made.append(Recording(PartInfo(part=f"p{k}", machine="m", order=k + 1, start_time_s=40.0 * k), columns))
        wants.append(heat)
    return made, wants


def piece(recording, at, keeps_time):
    """The rows from `at` on, which begin that much later on the machine's clock."""
    rest = recording.rows(slice(at, None))
    about = rest.part.model_copy(update={"start_time_s": recording.part.start_time_s + at * STEP})
    time = rest.time if keeps_time else rest.time - rest.time[0]
    return replace(rest, part=about).with_columns(time=time)


def test_the_machines_clock_is_that_of_the_first_sample_wherever_a_parts_time_begins(warming):
    parts, heat = warming
    found = diagnose(parts[:3])
    assert [f.mechanism for f in found.findings] == ["thermal_drift"]
    assert found.findings[0].parameters["tau"].value == pytest.approx(60.0, rel=0.1)
    np.testing.assert_allclose(found.model["history"], [[0.0, 29.98], [40.0, 69.98], [80.0, 109.98]])
    for keeps_time in (True, False):
        for at in (0, 750):
            mismatch = correct(found.model, piece(parts[3], at, keeps_time)).mismatch["x"]
            np.testing.assert_allclose(mismatch, heat[3][at:], atol=5e-3)


@pytest.mark.parametrize("clock", [1.0, 2.0, 3.0])
def test_a_machine_is_as_warm_as_its_clock_says_whether_a_part_keeps_its_time_or_not(clock, warming):
    drift = BY_ID["thermal_drift"]
    shape = {"tau": 60.0, "clock": clock, "along": 0.0, "rises": 0.0}
    one, other = (
        axis_states([*warming[0][:2], piece(warming[0][2], 500, keeps_time)], "x")[2] for keeps_time in (True, False)
    )
    np.testing.assert_allclose(one.earlier, [(0.0, 29.98), (40.0, 69.98)])
    np.testing.assert_allclose(drift.regressors(one, **shape), drift.regressors(other, **shape))
