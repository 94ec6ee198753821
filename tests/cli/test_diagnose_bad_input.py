"""What `pido diagnose` says of recordings that it cannot compare, or only in part; it never makes a finding up."""

import json
import re

import numpy as np
import pytest

from pido.core.part import PartInfo
from pido.core.recording import Recording
from pido.recordings.folder import write_folder

ROWS = 1200


@pytest.fixture
def diagnose(tmp_path, call):
    """`diagnose(folders, ...)`: exit code, findings (axis, mechanism), clean axes, what stood on stderr."""

    def run(*words):
        out = tmp_path / "out"
        code, said, err = call("diagnose", *words, "--out", out)
        if code:
            assert not said
            assert not out.exists()
            return code, None, None, err
        told = json.loads((out / "diagnosis.json").read_text())
        return code, [(f["axis"], f["mechanism"]) for f in told["findings"]], told["clean_axes"], err

    return run


@pytest.fixture
def made(tmp_path):
    """`made(change, ...)`: three part folders; `change(columns, number)` returns the columns that are written."""

    def make(change=lambda c, k: c, machine=lambda k: "cmx600v", count=3, rows=ROWS):
        return [
            write_folder(
                Recording(PartInfo(part=f"p{k}", machine=machine(k), order=k), change(_columns(k, rows), k)),
                tmp_path / f"p{k}",
            )
            for k in range(1, count + 1)
        ]

    return make


def _columns(seed, rows):
    """x lacks viscous friction in its simulation, and y's current is its own."""
    rng = np.random.default_rng(seed)
    t = np.arange(rows) * 0.02
    columns = {"time": t}
    for axis, friction in (("x", 0.03), ("y", 0.0)):
        v = np.convolve(np.repeat(rng.choice([-12.0, -5.0, 5.0, 12.0], rows // 50), 50), np.ones(9) / 9, "same")
        sim = 0.5 * np.sign(v)
        columns |= {f"pos_{axis}": np.cumsum(v) * 0.02, f"v_{axis}": v, f"a_{axis}": np.gradient(v, t)}
        columns |= {f"curr_{axis}": sim + friction * v + rng.normal(0, 0.03, rows), f"curr_{axis}_sim": sim}
    return columns


def only(columns, axis):
    other = "y" if axis == "x" else "x"
    return {name: values for name, values in columns.items() if f"_{other}" not in name}


def blank(columns, name, rows):
    return columns | {name: np.where(rows, np.nan, columns[name])}


FIRST = np.arange(ROWS) < ROWS // 2
NOTHING_COMPARED = {
    "simulation before the recording": (
        lambda c, k: blank(blank(only(c, "x"), "curr_x", FIRST), "curr_x_sim", ~FIRST),
        "do not overlap in time",
    ),
    "simulation of one part elsewhere in time": (
        lambda c, k: blank(only(c, "x"), "curr_x_sim", np.full(ROWS, k == 2)),
        "in part p2, recording and simulation do not overlap",
    ),
    "simulation shorter than can be judged": (
        lambda c, k: blank(only(c, "x"), "curr_x_sim", np.arange(ROWS) > 400),
        "overlap in 401 samples",
    ),
    "simulation at a fifth of the rate": (
        lambda c, k: blank(only(c, "x"), "curr_x_sim", np.arange(ROWS) % 5 > 0),
        "Bring both to one rate",
    ),
    "no current at all": (
        lambda c, k: {n: v for n, v in c.items() if "curr" not in n},
        "no part has a recorded current",
    ),
    "a constant recording": (
        lambda c, k: c | {"curr_x": np.full(ROWS, 2.0), "curr_y": np.zeros(ROWS)},
        "'curr_x' is constant (2)",
    ),
    "nothing but currents": (
        lambda c, k: {n: v for n, v in c.items() if n in ("time", "curr_x", "curr_x_sim")},
        "Record at least the motion",
    ),
    "an axis that stands still": (
        lambda c, k: only(c, "x") | {n: np.zeros(ROWS) for n in ("pos_x", "v_x", "a_x")},
        "no other signal varies",
    ),
    "time that never ends": (
        lambda c, k: c | {"time": np.where(np.arange(ROWS) == ROWS - 1, np.inf, c["time"])},
        "part p1, 1 sample at t = 23.96 s: time is missing",
    ),
    "time that stands still": (
        lambda c, k: c | {"time": np.where(np.arange(ROWS) == 500, c["time"][499], c["time"])},
        "part p2, 1 sample at t = 9.98 s: time stands still",
    ),
    "time in milliseconds": (lambda c, k: c | {"time": 1000.0 * c["time"]}, "looks like ms; it must be in s"),
    "time in milliseconds, one axis": (
        lambda c, k: only(c | {"time": 1000.0 * c["time"]}, "x"),
        "looks like ms; it must be in s",
    ),
    "time that goes back": (lambda c, k: c | {"time": c["time"][::-1].copy()}, "time goes backward"),
}  # fmt: skip


@pytest.mark.parametrize("case", NOTHING_COMPARED)
def test_what_cannot_be_compared_ends_with_its_reason_and_no_files(case, made, diagnose):
    change, says = NOTHING_COMPARED[case]
    code, _, _, err = diagnose(*made(change))
    assert code == 1
    assert says in err
    assert err.startswith("pido: ")


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (("--pair", "force:curr_x_sim"), "'force', which is not there; it has time, pos_x"),
        (("--pair", "curr_x:force"), "'force', which is not there"),
        (("--pair", "curr_x:curr_x"), "two different column names"),
        (("--machine", "no such mill"), "no such mill"),
    ],
)
def test_a_column_or_machine_that_is_not_there_is_named(words, says, made, diagnose):
    code, _, _, err = diagnose(*made(), *words)
    assert code == 1
    assert says in err


def test_the_same_part_twice_or_two_machines_are_refused(made, diagnose):
    parts = made(machine=lambda k: "cmx600v" if k < 3 else "dmc60h")
    for given, says in (
        ([parts[0], parts[0]], "p1 was given more than once"),
        (parts, "2 machines: cmx600v, dmc60h"),
    ):
        code, _, _, err = diagnose(*given)
        assert code == 1
        assert says in err


def test_an_empty_folder_or_too_few_samples_are_refused_by_name(made, diagnose, tmp_path):
    short = made(rows=100)
    (tmp_path / "empty").mkdir()
    for given, says in (([tmp_path / "empty"], "empty: the folder is empty"), (short, "p1: 100 samples; at least 500")):
        code, _, _, err = diagnose(*given)
        assert code == 1
        assert says in err


def test_an_identifier_that_is_no_file_name_is_refused_before_anything_is_compared(made, diagnose):
    (part,) = made(count=1)
    about = part / "part.json"
    about.write_text(json.dumps(json.loads(about.read_text()) | {"part": "p" * 300}))
    code, _, _, err = diagnose(part)
    assert code == 1
    assert "300 characters as a file name" in err


def test_one_short_part_says_what_can_still_be_concluded(made, diagnose):
    code, found, clean, err = diagnose(*made(lambda c, k: only(c, "x"), count=1))
    assert (code, found, clean) == (0, [("x", "viscous_friction")], [])
    assert "contiguous blocks of the same recording" in err
    assert "less than a minute" in err


def test_one_axis_that_cannot_be_judged_does_not_cost_the_others_theirs(made, diagnose):
    def change(columns, k):
        """y has no current in p1, and a name nobody knows in every part."""
        mine = {n: v for n, v in columns.items() if (n, k) != ("curr_y", 1)}
        return mine | {"cur_y": columns["curr_y"]}

    code, found, clean, err = diagnose(*made(change))
    assert (code, found, clean) == (0, [("x", "viscous_friction")], [])
    assert "axis y is left out: no 'curr_y' in p1" in err
    assert "the contract does not know: cur_y" in err


def test_missing_and_infinite_values_are_left_out_not_explained(made, diagnose):
    def change(columns, k):
        gap = (np.arange(ROWS) > 300) & (np.arange(ROWS) < 420)
        for name in list(columns):
            if name != "time":
                columns = blank(columns, name, gap)
        return only(columns | {"curr_x": np.where(np.arange(ROWS) % 400 == 7, np.inf, columns["curr_x"])}, "x")

    code, found, _, err = diagnose(*made(change))
    assert (code, found) == (0, [("x", "viscous_friction")])
    assert "infinite values of curr_x are taken as missing" in err


def test_a_column_without_any_value_is_as_one_that_was_not_recorded(made, diagnose):
    code, found, _, err = diagnose(*made(lambda c, k: only(blank(c, "pos_x", np.full(ROWS, True)), "x")))
    assert (code, found) == (0, [("x", "viscous_friction")]), err


def test_a_simulation_without_any_value_gives_way_to_the_equation(made, diagnose):
    empty = np.full(ROWS, True)
    without = diagnose(*made(lambda c, k: {n: v for n, v in c.items() if n != "curr_x_sim"}))
    code, found, clean, err = diagnose(*made(lambda c, k: blank(c, "curr_x_sim", empty)))
    assert (code, found, clean) == without[:3]
    assert code == 0
    assert "curr_x_sim: without any value in any part, and taken as not recorded" in err
    assert "axis x: no simulated current; compared with the physical equation" in err


def test_a_speed_in_another_unit_is_said_and_what_was_found_stands_beside_it(made, diagnose, tmp_path):
    code, _, _, err = diagnose(*made(lambda c, k: only(c, "x") | {"v_x": 60.0 * c["v_x"]}, count=1))
    assert code == 0
    assert "part p1: v_x: 'v_x' is 60 times the derivative of its position. It looks like mm/min" in err
    assert any("mm/min" in note for note in json.loads((tmp_path / "out" / "details.json").read_text())["notes"])


@pytest.mark.parametrize("pair", [pytest.param((), marks=pytest.mark.thorough), ("--pair", "f_y:f_y_sim")])
def test_a_wrong_input_is_told_with_its_place_and_nothing_is_claimed_of_a_fit(pair, made, diagnose, tmp_path):
    """x moves wrongly in the second part; with --pair only y is compared."""

    def change(columns, number):
        columns |= {"f_y": columns["curr_y"], "f_y_sim": columns["curr_y_sim"]}
        if number == 2:
            columns["v_x"] = np.where(np.isin(np.arange(ROWS), [700, 701]), 9e4, columns["v_x"])
        return columns

    code, found, _, err = diagnose(*made(change), *pair)
    assert code == 0, err
    assert ("x", "input_fault") in found
    out = tmp_path / "out"
    fault, details = (
        next(f for f in json.loads((out / name).read_text())["findings"] if f["mechanism"] == "input_fault")
        for name in ("diagnosis.json", "details.json")
    )
    wrong = next(f for f in details["faults"] if f["column"] == "v_x")
    assert (wrong["part"], wrong["t_start"], wrong["t_end"]) == ("p2", 14.0, pytest.approx(14.02))
    assert fault["where"]["summary"].startswith("a_x and v_x are wrong in 1 place, first in part p2 at 1")
    fit, judged = fault["fit"], "y" if pair else "x"
    tables = [_columns(k, ROWS) for k in (1, 2, 3)]
    left = np.concatenate([t[f"curr_{judged}"] - t[f"curr_{judged}_sim"] for t in tables])
    assert fit["rmse_before"] == pytest.approx(np.sqrt(np.mean(left**2)))
    assert fit["rmse_after"] == pytest.approx(fit["rmse_before"], rel=0.02)
    assert f"axis {judged}" in fit["scheme"]
    assert fit["p_value"] == 0  # of the fault itself
    page = (out / "report.html").read_text(encoding="utf-8")
    assert "v_x, where it is wrong first" in page


@pytest.mark.parametrize(("sample", "start"), [pytest.param(700, 14.0, marks=pytest.mark.thorough), (ROWS - 1, 23.96)])
def test_a_single_sample_that_is_wrong_lasts_a_step(sample, start, made, diagnose, tmp_path):
    def change(columns, _):
        return columns | {"a_x": np.where(np.arange(ROWS) == sample, 9e6, columns["a_x"])}

    assert ("x", "input_fault") in diagnose(*made(change))[1]
    told = json.loads((tmp_path / "out" / "diagnosis.json").read_text())["findings"]
    (fault,) = [f for f in told if f["mechanism"] == "input_fault"]
    spans = [(i["t_start"], i["t_end"]) for i in fault["where"]["intervals"]]
    np.testing.assert_allclose(spans, [(start, start + 0.02)] * 3)


def test_the_verdict_says_how_little_stands_behind_it_and_which_axes_were_not_judged(made, diagnose, tmp_path):
    def change(columns, number):
        columns |= {"curr_x": columns["curr_x_sim"] + np.random.default_rng(5).normal(0, 0.03, ROWS)}
        return columns | {"curr_z": np.full(ROWS, 2.0), "curr_z_sim": np.zeros(ROWS), "pos_z": np.zeros(ROWS)}

    code, found, clean, _ = diagnose(*made(change, count=1))
    assert (code, found, clean) == (0, [], ["x", "y"])
    page = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    verdict = re.search(r"Simulation and recording agree.*?</p>", page, re.DOTALL).group()
    assert re.search(r"x moves for 2\d(\.\d)? s, y moves for 2\d(\.\d)? s", verdict)
    assert "only strong effects" in verdict
    assert "Not judged: z, sp." in verdict


def test_parts_at_different_rates_are_judged_together_and_half_a_simulation_says_so(made, diagnose):
    def change(columns, k):
        mine = only(columns, "x")
        if k == 1:
            return {name: values[::2] for name, values in mine.items()}
        return blank(mine, "curr_x_sim", FIRST) if k == 2 else mine

    code, found, _, err = diagnose(*made(change))
    assert (code, found) == (0, [("x", "viscous_friction")])
    assert "covers 50% of part p2" in err


def test_a_tool_that_is_not_named_at_first_is_no_hindrance(made, diagnose, call, tmp_path):
    tool = np.array([None] * 40 + ["T1"] * (ROWS - 40), object)
    parts = made(lambda c, k: only(c, "x") | {"tool_id": tool})
    code, found, _, err = diagnose(*parts)
    assert (code, found) == (0, [("x", "viscous_friction")]), err
    assert call("correct", tmp_path / "out", parts[0], "--out", tmp_path / "corrected.parquet")[0] == 0


def settings_of(path, *names):
    """A settings file with these machines."""
    axes = "\n".join(
        f"[NAME.{a}]\nv_max = 500.0\na_max = 5000.0\nj_max = 50000.0\ntravel_mm = [-500.0, 500.0]" for a in "xyz"
    )
    each = f'[NAME]\nvertical_axis = "z"\nforce_max_n = 4000.0\n{axes}\n[NAME.spindle]\nmax_rpm = 24000.0\n'
    path.write_text("".join(each.replace("NAME", name) for name in names))
    return path


@pytest.mark.thorough
def test_a_machine_of_ones_own_is_taken_from_its_file(made, diagnose, tmp_path):
    own = settings_of(tmp_path / "machines.toml", "portal", "gantry")
    parts = made(machine=lambda k: "portal")
    for more in ((), ("--machine", "portal")):
        code, found, _, said = diagnose(*parts, *more, "--settings", own)
        assert code == 0
        assert ("x", "viscous_friction") in found
        assert ("machine 'portal', as" in said) == (not more)


@pytest.mark.thorough
def test_the_parts_machine_has_its_dead_band_from_the_settings_that_know_it(made, diagnose, tmp_path):
    own = settings_of(tmp_path / "machines.toml", "gantry", "portal")
    own.write_text(own.read_text().replace("[portal.x]", "[portal.x]\ndead_band = 40.0"))  # faster than the parts go
    code, found, _, _ = diagnose(*made(machine=lambda k: "portal"), "--settings", own)
    assert code == 0
    assert ("x", "viscous_friction") not in found


@pytest.mark.parametrize(
    ("there", "machine", "says"),
    [
        (("portal", "gantry"), lambda k: "other", "the parts are of 'other'"),
        (("portal",), lambda k: "other", "'portal'"),
        ((), lambda k: "other", "no machine"),
        (("portal", "gantry"), lambda k: ("portal", "gantry", "portal")[k - 1], "'gantry', 'portal'"),
    ],
)
def test_settings_that_leave_the_machine_open_are_refused_with_the_names_that_are_there(
    made, diagnose, tmp_path, there, machine, says
):
    own = settings_of(tmp_path / "machines.toml", *there)
    code, _, _, said = diagnose(*made(machine=machine), "--settings", own)
    assert code == 2
    assert says in said
    assert "--machine" in said
    assert all(name in said for name in there)


@pytest.mark.thorough
def test_the_only_machine_of_the_settings_is_that_of_parts_that_name_none(made, diagnose, tmp_path):
    own = settings_of(tmp_path / "machines.toml", "portal", "gantry")
    parts = [folder / "recording.parquet" for folder in made()]
    for part in parts:
        (part.parent / "part.json").unlink()
    parts = [part.rename(tmp_path / f"{part.parent.name}.parquet") for part in parts]
    code, _, _, said = diagnose(*parts, "--settings", own)
    assert code == 2
    assert "no part.json says" in said
    code, found, _, said = diagnose(*parts, "--settings", settings_of(own, "portal"))
    assert code == 0
    assert ("x", "viscous_friction") in found
    assert "machine 'portal'" in said
