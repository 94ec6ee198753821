"""The contract's files and the page, from a diagnosis whose content is known."""

import json
from dataclasses import replace
from html.parser import HTMLParser

import numpy as np
import pyarrow.parquet as pq
import pytest
from written_diagnosis import term_of

from pido.core.errors import DiagnosisError
from pido.core.part import PartInfo
from pido.core.recording import Recording
from pido.diagnoses import summary
from pido.diagnosis import contract
from pido.diagnosis.finding import (
    Alternative,
    Diagnosis,
    Estimate,
    Evidence,
    FaultySignal,
    Finding,
    HeldOut,
    Interval,
    PartSeries,
    Rejected,
    Where,
)
from pido.reports.diagnosis import diagnosis_page
from pido.reports.page import extremes, render, write_page

HOSTILE = '../<script>alert("p")</script>'


class _Fetched(HTMLParser):
    """What a browser would load for the page's own tags (the text of a script is not parsed as tags)."""

    def __init__(self) -> None:
        super().__init__()
        self.urls: list[str] = []

    def handle_starttag(self, tag, attrs):
        self.urls += [value for name, value in attrs if name in ("src", "href") and value]


def _recording(part: str = "p01", n: int = 30_000) -> Recording:
    t = np.arange(n) / 50.0
    v = 5.0 * np.sin(t)
    columns = {"time": t, "v_x": v, "v_y": v * 0.3, "pos_x": np.cumsum(v) / 50, "pos_y": np.cumsum(v) / 150}
    columns["curr_x"] = np.sign(v) * 1.4
    return Recording(PartInfo(part=part, machine="m1"), columns)


def _diagnosis(part: str = "p01") -> tuple[Diagnosis, Recording]:
    recording = _recording(part)
    mismatch = 0.4 * np.sign(recording["v_x"])
    series = PartSeries(
        recording.time, {"x": mismatch}, {"x": (np.abs(mismatch) > 0.1).astype(float)}, {"x": recording["curr_x"]}
    )
    finding = Finding(
        axis="x",
        mechanism="stribeck_friction",
        kind="missing_physics",
        equation="dI_x = (F_s - F_c) * exp(-(|v_x|/v_s)^2) * sgn(v_x)",
        parameters={"F_s": Estimate(0.41, "A", (0.37, 0.45))},
        where=Where("below |v_x| = 1.3 mm/s", ("|v_x| < 1.3",), (Interval(part, 12.4, 13.1, 0.97),)),
        evidence=Evidence(1e-6, 3e-6, 212.0),
        fit=HeldOut("leave-one-part-out", 0.31, 0.12, 0.62, float("nan"), 1e-5),
        replaces=("sgn(v_x)",),
        alternatives=(Alternative("presliding_hysteresis", 14.0, "an air cut at three feeds, 40 s"),),
    )
    rejected = (Rejected("x", "backlash", "no gain on unseen parts"),)
    model = {"axes": {"x": {"terms": [term_of("stribeck_friction", {"v_s": 1.0, "delta": 2.0})]}}}
    return Diagnosis((finding,), ("y", "z", "sp"), {part: series}, model, rejected), recording


def test_the_files_hold_exactly_the_keys_of_the_contract(tmp_path):
    diagnosis, _ = _diagnosis()
    contract.write(diagnosis, tmp_path)
    written = json.loads((tmp_path / "diagnosis.json").read_text())
    assert set(written) == {"schema", "findings", "clean_axes"}
    assert written["schema"] == "pido.diagnosis/1"
    (finding,) = written["findings"]
    assert set(finding) == {
        "axis", "mechanism", "kind", "equation", "parameters", "where", "evidence", "fit", "replaces", "alternatives",
    }  # fmt: skip
    assert finding["parameters"] == {"F_s": {"value": 0.41, "unit": "A", "ci95": [0.37, 0.45]}}
    assert set(finding["where"]) == {"summary", "conditions", "intervals"}
    assert finding["where"]["intervals"] == [{"part": "p01", "t_start": 12.4, "t_end": 13.1, "score": 0.97}]
    assert finding["alternatives"] == [{"mechanism": "presliding_hysteresis", "delta_bic": 14.0}]
    assert finding["fit"]["r2_after"] is None  # JSON has no NaN
    table = pq.read_table(tmp_path / "parts" / "p01.parquet")
    assert table.column_names == ["time", "mismatch_x", "mismatch_score_x", "curr_x_corrected"]
    assert table.num_rows == 30_000


def test_a_model_comes_back_as_it_was_written_and_another_file_is_refused(tmp_path):
    diagnosis, _ = _diagnosis()
    contract.write(diagnosis, tmp_path)
    assert contract.read_model(tmp_path) == diagnosis.model
    (tmp_path / "model.json").write_text('{"schema": "something else"}')
    with pytest.raises(DiagnosisError, match="schema"):
        contract.read_model(tmp_path)
    with pytest.raises(DiagnosisError, match="pido diagnose"):
        contract.read_model(tmp_path / "nowhere")


def test_a_part_with_a_hostile_name_stays_in_its_folder_and_is_shown_not_run(tmp_path):
    diagnosis, recording = _diagnosis(HOSTILE)
    contract.write(diagnosis, tmp_path / "out")
    assert [p.parent for p in tmp_path.rglob("*.parquet")] == [tmp_path / "out" / "parts"]
    assert '<script>alert("p")' not in render(diagnosis_page(diagnosis, [recording]))


def test_the_page_is_one_small_file_that_fetches_nothing(tmp_path):
    diagnosis, recording = _diagnosis()
    page = tmp_path / "report.html"
    write_page(diagnosis_page(diagnosis, [recording]), page)
    html = page.read_text(encoding="utf-8")
    assert page.stat().st_size <= 3_000_000
    fetched = _Fetched()
    fetched.feed(html)
    assert fetched.urls == []
    for wanted in ("stribeck_friction", "narrower than 2 % of its value", "0.31",
                   "0.12", "an air cut at three feeds, 40 s", "no gain on unseen parts",
                   "pido accept-physics FOLDER --finding x:stribeck_friction"):  # fmt: skip
        assert wanted in html


def test_the_page_offers_no_finding_that_would_be_refused_and_says_why():
    diagnosis, recording = _diagnosis()
    terms = [term_of("inertia", {}), *diagnosis.model["axes"]["x"]["terms"]]
    both = (replace(diagnosis.findings[0], mechanism="inertia"), *diagnosis.findings)
    diagnosis = replace(diagnosis, findings=both, model={"axes": {"x": {"terms": terms}}})
    html = render(diagnosis_page(diagnosis, [recording]))
    assert "--finding x:stribeck_friction" in html
    assert "--finding x:inertia" not in html
    assert "Not x:inertia: it is in the equation already, by a_x." in html


def test_with_nothing_found_the_page_says_so():
    _, recording = _diagnosis()
    html = render(diagnosis_page(Diagnosis((), ("x",), {}, {}), [recording]))
    assert "nothing systematic is left out" in html


def test_thinning_a_signal_keeps_its_extremes():
    y = np.zeros(100_000)
    y[12_345], y[54_321] = 7.0, -9.0
    x, thinned = extremes(np.arange(100_000.0), y, most=500)
    assert len(x) <= 500
    assert thinned.max() == 7.0
    assert thinned.min() == -9.0
    assert x[np.argmax(thinned)] == 12_345


def test_only_what_is_nearly_as_likely_is_called_possible_and_asks_for_a_recording():
    diagnosis, recording = _diagnosis()
    far = Alternative("backlash", 8000.0, "reversals with pauses")
    (finding,) = diagnosis.findings
    finding = replace(finding, alternatives=(*finding.alternatives, far))
    html = render(diagnosis_page(replace(diagnosis, findings=(finding,)), [recording]))
    assert "reversals with pauses" not in html
    assert "clearly less well: a transient after each reversal" in html


def test_what_fits_better_and_is_not_the_finding_is_told_why():
    diagnosis, recording = _diagnosis()
    (finding,) = diagnosis.findings
    finding = replace(finding, alternatives=(Alternative("backlash", -310.0, "reversals with pauses"),))
    html = render(diagnosis_page(replace(diagnosis, findings=(finding,)), [recording]))
    assert "also allow" not in html
    assert "Fits these rows better, and is not the finding because it takes more numbers or does less on data" in html


def test_without_a_finding_the_signals_are_shown_all_the_same():
    recording = _recording()
    zero = np.zeros(len(recording))
    series = PartSeries(recording.time, {"x": zero}, {"x": zero}, {"x": recording["curr_x"]})
    html = render(diagnosis_page(Diagnosis((), ("x",), {"p01": series}, {}), [recording]))
    assert "where it differs most" in html


def test_a_fault_of_the_inputs_claims_no_fit():
    diagnosis, recording = _diagnosis()
    wrong = tuple(FaultySignal("p01", "v_x", 4.0 * k, 4.0 * k + 0.02, "spike") for k in range(3, 60))
    fault = replace(
        diagnosis.findings[0],
        mechanism="input_fault",
        parameters={},
        where=Where("v_x is wrong", faults=wrong),
        evidence=Evidence(0.0, 0.0, 0.0),
        fit=HeldOut("nothing fitted", 0.0201, 0.0202, 0.97, 0.98, 1.0),
    )
    only = replace(diagnosis, findings=(fault, diagnosis.findings[0]))
    page = diagnosis_page(only, [recording])
    _, section, other = page.sections[:3]
    assert "no fit is needed" in " ".join(section.text)
    for claimed in ("falls from", "1e-12", "unseen", "0.0201"):
        assert claimed not in " ".join([page.verdict, *section.text, *summary(only)[:1]])
    assert section.table.rows[0] == ("p01", "v_x", "12.00", "12.02", "spike")
    assert len(section.table.rows) < len(wrong)
    assert "details.json" in " ".join(section.text)
    assert "speed of the x axis, mm/s" in " ".join(section.text)
    assert len(section.table.rows) < 20  # the picture is not far below
    (plot,) = section.figures  # the faulty signal where it is first wrong; the current stands with what is found in it
    (line,) = plot.renderers
    at = line.data_source.data["x"]
    assert 12.0 - 7.0 < min(at) < 12.0 < max(at) < 12.0 + 7.0
    np.testing.assert_allclose(line.data_source.data["y"], 5.0 * np.sin(at))
    assert len(other.figures) > 1


def test_an_error_on_data_of_the_fit_is_not_said_to_be_on_unseen_ones():
    diagnosis, recording = _diagnosis()
    shift = HeldOut("one shift for all parts and axes", 0.31, 0.12, 0.62, 0.9, 1e-5)
    page = diagnosis_page(replace(diagnosis, findings=(replace(diagnosis.findings[0], fit=shift),)), [recording])
    assert "the error falls from 0.31 to 0.12 A" in page.verdict
    assert "nseen data" not in render(page)
    assert "held-out" not in render(page)


def test_errors_beside_other_findings_of_the_axis_are_said_to_be_so():
    diagnosis, recording = _diagnosis()
    one = diagnosis.findings[0]
    (line, _) = summary(diagnosis)
    assert line.endswith("RMSE 0.31 -> 0.12 (leave-one-part-out)")
    two = replace(diagnosis, findings=(one, replace(one, mechanism="backlash"), replace(one, axis="y")))
    beside = "without it -> with it, beside the axis' other findings"
    assert [beside in line for line in summary(two)] == [True, True, False, False]
    assert render(diagnosis_page(two, [recording])).count("without it → with it") == 2


def test_a_finding_without_a_name_shows_its_formula_in_the_summary():
    diagnosis, _ = _diagnosis()
    formula = "dI_x = k * v_x * v_y"
    where = replace(diagnosis.findings[0].where, summary="depending on v_x and v_y")
    unknown = replace(diagnosis.findings[0], mechanism="unknown", kind="unexplained", equation=formula, where=where)
    (line, _) = summary(replace(diagnosis, findings=(unknown,)))
    assert line.startswith(f"x   unknown   depending on v_x and v_y: {formula}   RMSE")


def test_the_knots_of_a_curve_share_one_row_and_few_numbered_parameters_have_their_own():
    diagnosis, recording = _diagnosis()
    finding = diagnosis.findings[0]

    def rows(count: int) -> list[str]:
        knots = {f"g_{i}": Estimate(0.1 * i, "A", (0.1 * i - 0.05, 0.1 * i + 0.05)) for i in range(count)}
        with_lag = {**knots, "lag": Estimate(0.02, "s", (0.01, 0.03))}
        page = diagnosis_page(replace(diagnosis, findings=(replace(finding, parameters=with_lag),)), [recording])
        (table,) = [s.table for s in page.sections if s.table is not None and "parameter" in s.table.head]
        return [" ".join(map(str, row)) for row in table.rows]

    assert rows(42) == ["g_0 … g_41 42 values, 0 to 4.1 A each in diagnosis.json", "lag 0.02 s 0.01 … 0.03 s"]
    assert len(rows(3)) == 4


def test_numbered_parameters_of_several_laws_have_a_row_each():
    diagnosis, recording = _diagnosis()
    laws = {f"k_{i}": Estimate(0.1, unit, (0.0, 0.2)) for i, unit in enumerate(["A", "A/mm", "A/N"] * 4)}
    page = diagnosis_page(replace(diagnosis, findings=(replace(diagnosis.findings[0], parameters=laws),)), [recording])
    (table,) = [s.table for s in page.sections if s.table is not None and "parameter" in s.table.head]
    assert len(table.rows) == 12


def test_errors_that_a_rare_effect_hardly_changes_are_said_in_digits_that_differ():
    diagnosis, recording = _diagnosis()
    rare = replace(diagnosis.findings[0], fit=HeldOut("leave-one-part-out", 3.42467, 3.41933, 0.7, 0.8, 0.001))
    only = replace(diagnosis, findings=(rare,))
    assert summary(only)[0].endswith("RMSE 3.425 -> 3.419 (leave-one-part-out)")
    assert "falls from 3.425 to 3.419" in diagnosis_page(only, [recording]).verdict


def test_the_title_of_a_plot_names_its_axis_and_fits_a_phone_however_long_the_part_is_called():
    diagnosis, recording = _diagnosis("Gehäusedeckel_" + "sehr_lang_" * 18 + "17")
    plots = [plot for section in diagnosis_page(diagnosis, [recording]).sections for plot in section.figures]
    about = [plot.title.text.text.splitlines() for plot in plots if "part" in plot.title.text.text]
    assert about
    for lines in about:
        assert lines[0].startswith("Axis x, part Gehäuse")
        assert "17:" in lines[0]
        assert max(map(len, lines)) <= 40


def test_a_verdict_on_enough_motion_of_all_axes_has_no_reservation():
    diagnosis, recording = _diagnosis()
    long = Diagnosis((), ("x", "y", "z", "sp"), {}, {}, moving_s=dict.fromkeys(("x", "y", "z", "sp"), 600.0))
    assert diagnosis_page(long, [recording]).verdict.endswith("left out on x, y, z, sp.")
    still = replace(long, moving_s={**long.moving_s, "y": None, "z": 0.0})
    assert "friction and inertia are not judged: y, z." in diagnosis_page(still, [recording]).verdict
    found = replace(diagnosis, moving_s={"x": 3.0, "y": 4.0, "z": 600.0, "sp": 600.0})
    verdict = diagnosis_page(found, [recording]).verdict
    assert "y moves for 4 s" in verdict  # of x something was found
    assert "x moves" not in verdict


def test_a_force_tied_to_times_is_shown_with_them_and_said_to_predict_nothing(tmp_path):
    diagnosis, recording = _diagnosis()
    times = tuple(Interval("p01", 40.0 * k + 5, 40.0 * k + 13, 0.9) for k in range(40))
    force = replace(
        diagnosis.findings[0],
        mechanism="external_force",
        where=Where("x axis, over single intervals of time", intervals=times),
        alternatives=(),
        to_record="a signal of the lubrication pump",
    )
    found = replace(diagnosis, findings=(force,))
    page = diagnosis_page(found, [recording])
    (section,) = [s for s in page.sections if s.title == "Axis x: external_force"]
    text = " ".join(section.text)
    assert "p01 5.0 to 13.0, 45.0 to 53.0" in text
    assert "more in diagnosis.json" in text
    assert "1565.0" not in text  # the last of many
    assert "predicts no other part" in text
    (asked,) = [s.text for s in page.sections if s.title == "What to record next"]
    assert asked == ["Axis x, external_force, to know more: a signal of the lubrication pump"]
    contract.write(found, tmp_path)
    (detail,) = json.loads((tmp_path / "details.json").read_text())["findings"]
    assert detail["to_record"] == "a signal of the lubrication pump"
    assert len(json.loads((tmp_path / "diagnosis.json").read_text())["findings"][0]["where"]["intervals"]) == 40


def test_the_page_tells_the_size_of_each_force_beside_its_times_and_no_use_of_it_elsewhere():
    diagnosis, recording = _diagnosis()
    own = {"id": "external_force", "intervals": [["p01", 5.0, 13.0], ["p01", 45.0, 53.0]]}
    term = {"name": "external_force", "mechanism": own, "shape": {}, "gates": [], "amplitudes": [0.15, -0.04], "lag": 0}
    force = replace(
        diagnosis.findings[0],
        mechanism="external_force",
        parameters={"F_1": Estimate(0.15, "A", (0.1, 0.2)), "F_2": Estimate(-0.04, "A", (-0.05, -0.03))},
        where=Where("x axis", intervals=(Interval("p01", 5, 13, 0.9), Interval("p01", 45, 53, 0.9))),
    )
    found = replace(diagnosis, findings=(force,), model={"axes": {"x": {"terms": [term]}}})
    page = diagnosis_page(found, [recording])
    (section,) = [s for s in page.sections if s.title == "Axis x: external_force"]
    assert "p01 5.0 to 13.0 (F_1 = 0.15 A), 45.0 to 53.0 (F_2 = -0.04 A)" in " ".join(section.text)
    (use,) = [s.text for s in page.sections if s.title.startswith("What can become part")]
    assert "Apply it" not in use[0]
    assert "Nor does it predict any other part." in use[0]


@pytest.mark.parametrize(
    ("mechanism", "summary", "once"),
    [
        ("coolant_load", "x axis, while coolant is on", "coolant is on"),
        ("friction_asymmetry", "x axis, friction differs between + and - direction", "differs"),
        ("external_force", "x axis, over single intervals of time; it predicts no other part", "it predicts"),
        ("inertia", "while the x axis speeds up or slows down", "accelerate"),
    ],
)
def test_the_headline_says_nothing_twice(mechanism, summary, once):
    diagnosis, recording = _diagnosis()
    one = replace(diagnosis.findings[0], mechanism=mechanism, where=Where(summary))
    verdict = diagnosis_page(replace(diagnosis, findings=(one,)), [recording]).verdict.split(" With it")[0]
    assert verdict.count(once) == 1
    assert verdict.count("x axis") == 0
    assert verdict.count("direction") <= 1
    assert ",." not in verdict


def test_a_finding_is_called_by_what_was_said_of_it():
    diagnosis, recording = _diagnosis()
    warm = replace(
        diagnosis.findings[0],
        mechanism="thermal_drift",
        said="friction that falls as the machine warms up",
        where=Where("x axis, friction falls by 0.49 A with a time constant of 234 s"),
    )
    page = diagnosis_page(replace(diagnosis, findings=(warm,)), [recording])
    says = (
        "Axis x: friction that falls as the machine warms up (thermal_drift), by 0.49 A with a time constant of 234 s."
    )
    assert page.verdict.startswith(says)


@pytest.mark.parametrize(("named", "everywhere"), [(9, True), (4, False)])
def test_a_list_of_nearly_all_blocks_is_told_in_words(named, everywhere):
    diagnosis, recording = _diagnosis()
    recording = recording.with_columns(nc_line=np.arange(len(recording)) % 10 * 10.0)
    where = replace(diagnosis.findings[0].where, nc_lines=tuple(range(0, 10 * named, 10)))
    found = replace(diagnosis, findings=(replace(diagnosis.findings[0], where=where),))
    (line,) = [t for s in diagnosis_page(found, [recording]).sections for t in s.text if t.startswith("NC blocks")]
    assert line == ("NC blocks: nearly everywhere, in 9 of 10; all stand in details.json" if everywhere else
                    "NC blocks: 0, 10, 20, 30")  # fmt: skip


def test_a_scale_is_shown_as_a_factor():
    diagnosis, recording = _diagnosis()
    gain = replace(diagnosis.findings[0], parameters={"g - 1": Estimate(0.06987, "–", (0.06748, 0.07226))})
    page = diagnosis_page(replace(diagnosis, findings=(gain,)), [recording])
    (table,) = [s.table for s in page.sections if s.table is not None and "parameter" in s.table.head]
    assert table.rows == [("g", "× 1.070", "1.067 … 1.072")]


def test_an_axis_that_was_left_out_is_in_the_summary_with_the_reason():
    diagnosis, _ = _diagnosis()
    note = "axis z is left out: 'curr_z' is constant (0.3) throughout p01: nothing was measured there."
    found = replace(diagnosis, clean_axes=("y",), notes=(note,))
    assert summary(found)[1:] == [
        "y   nothing significant",
        "z   not judged: 'curr_z' is constant (0.3) throughout p01: nothing was measured there.",
        "sp   not judged: no current was recorded.",
    ]


def test_a_mismatch_is_shown_where_the_current_itself_does_not_hide_it():
    """It is as large in two places; in one the axis accelerates, with thirty times its current."""
    diagnosis, recording = _diagnosis()
    t = recording.time
    first, second = 0.2 * t[-1], 0.7 * t[-1]
    missing = 0.3 * ((np.abs(t - first) < 2) | (np.abs(t - second) < 2))
    simulated = 9.0 * (np.abs(t - first) < 1)
    series = PartSeries(t, {"x": missing}, {"x": missing}, {"x": simulated + missing})
    own = replace(diagnosis, parts={recording.part.part: series})
    made = recording.with_columns(curr_x=simulated + missing)
    section = next(s for s in diagnosis_page(own, [made]).sections if s.title.startswith("Axis x"))
    shown = np.asarray(section.figures[0].renderers[0].data_source.data["x"])
    assert shown.min() < second < shown.max()
    assert not shown.min() < first < shown.max()
