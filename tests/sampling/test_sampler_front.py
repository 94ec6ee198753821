"""`PiDOSampler` beside the contracts of scikit-learn and imbalanced-learn, and what the method promises through it."""

import numpy as np
import pandas as pd
import polars as pl
import pyarrow as pa
import pytest
from imblearn.pipeline import make_pipeline
from imblearn.utils import estimator_checks as imblearn_checks
from sklearn.base import clone
from sklearn.ensemble import ExtraTreesRegressor
from sklearn.utils.estimator_checks import parametrize_with_checks

from pido.core.columns import CURRENT, INPUTS
from pido.core.errors import FitError, RecordingError
from pido.core.machining import AxisLimits, Machine
from pido.equations.estimators import LocalPhysicalEquations
from pido.sampling.front import PiDOSampler

MACHINE = Machine(
    "m",
    {a: AxisLimits(100.0, 2000.0, 20_000.0, (-500.0, 500.0)) for a in "xyz"},
    spindle_max_deg_s=60_000.0,
    spindle_acc_deg_s2=60_000.0,
)


def cuts(n=1500, seed=0):
    """Straight cuts in all directions of a plane, with textbook currents; some bins hold many rows, most hold few."""
    rng = np.random.default_rng(seed)
    angle = rng.integers(0, 12, n) * np.pi / 6 + rng.normal(0, 0.05, n)
    feed = rng.choice([4.0, 8.0, 12.0], n, p=[0.7, 0.2, 0.1])
    X = pd.DataFrame(0.0, index=range(n), columns=list(INPUTS))
    X["v_x"], X["v_y"] = feed * np.cos(angle), feed * np.sin(angle)
    X["a_x"], X["a_y"] = rng.normal(0, 20, (2, n))
    X["v_sp"], X["mrr_sim"] = 22_800.0, 6.0 * feed
    X["f_x_sim"], X["f_y_sim"], X["m_sp_sim"] = -80 * np.cos(angle), -80 * np.sin(angle), 0.4
    y = pd.DataFrame(
        {
            "curr_x": 0.8 * np.sign(X["v_x"]) + 0.02 * X["v_x"] + rng.normal(0, 0.02, n),
            "curr_y": 0.6 * np.sign(X["v_y"]) + 0.03 * X["v_y"] + rng.normal(0, 0.02, n),
        }
    )
    return X, y


@parametrize_with_checks([PiDOSampler()])
def test_scikit_learns_checks_pass(estimator, check):
    check(estimator)


IMBLEARN = {
    "check_target_type": "it demands that continuous y is refused, and continuous y is what this sampler is for",
    "check_samplers_one_label": "there are no classes",
    "check_samplers_fit": "there is no sampling_strategy: bins are balanced, not classes",
    "check_samplers_fit_resample": "counts rows per class",
    "check_samplers_sparse": "a machine's motion is not sparse",
    "check_samplers_pandas": "its columns are named 0 to 19; names that are no input are refused",
    "check_samplers_pandas_sparse": "a machine's motion is not sparse",
    "check_samplers_multiclass_ova": "there are no classes",
    "check_samplers_preserve_dtype": "it demands whole numbers for y, and a generated current is none",
    "check_samplers_2d_target": "it demands that y of two dimensions is a class encoding",
    "check_sampler_get_feature_names_out_pandas": "its columns are named col0 to col2, which are no inputs",
    "check_samplers_sample_indices": "it reads a tag that only imbalanced-learn's own base class has",
}
APPLY = (
    "check_samplers_list",
    "check_samplers_sampling_strategy_fit_resample",
    "check_sampler_get_feature_names_out",
)


@pytest.mark.parametrize("name", [*APPLY, *IMBLEARN])
def test_imbalanced_learns_checks_that_apply_pass(name, monkeypatch):
    if name in IMBLEARN:
        pytest.skip(IMBLEARN[name])
    X, y = cuts(300)
    monkeypatch.setattr(imblearn_checks, "sample_dataset_generator", lambda: (X.to_numpy(), y["curr_x"].to_numpy()))
    getattr(imblearn_checks, name)("PiDOSampler", PiDOSampler(MACHINE, random_state=0))


@pytest.fixture(scope="module")
def resampled():
    X, y = cuts()
    sampler = PiDOSampler(MACHINE, density=400.0, random_state=3)
    return X, y, sampler, *sampler.fit_resample(X, y)


def test_real_rows_come_first_and_untouched(resampled):
    X, y, sampler, more_X, more_y = resampled
    n = len(X)
    assert len(more_X) > n
    pd.testing.assert_frame_equal(more_X.iloc[:n], X)
    pd.testing.assert_frame_equal(more_y.iloc[:n], y)
    assert (sampler.sample_origin_["origin"][:n] == "real").all()
    assert (sampler.sample_origin_["origin"][n:] != "real").all()


def test_a_pia_row_is_the_row_of_x_that_it_names(resampled):
    X, _, sampler, more_X, _ = resampled
    pia = np.flatnonzero(sampler.sample_origin_["origin"] == "pia")
    assert len(pia)
    np.testing.assert_array_equal(more_X.iloc[pia], X.iloc[sampler.sample_origin_["row"][pia]])


def test_generated_rows_lie_in_the_bin_they_were_made_for_and_within_the_machine(resampled):
    _, _, sampler, X, _ = resampled
    origin = sampler.sample_origin_
    made = origin["origin"] != "real"
    for name, width in (("v_x", 2.0), ("v_y", 2.0)):
        assert (np.abs(X[name].to_numpy()[made] - origin[name][made]) <= width / 2).all()
    assert (X["a_x"].abs() <= 2000).all()
    speed = np.linalg.norm(X[["v_x", "v_y", "v_z"]].to_numpy()[made], axis=1)
    assert (np.abs(X["mrr_sim"].to_numpy()[made] / speed - origin["ar"][made]) <= 1.0 + 1e-9).all()


def test_generated_currents_obey_the_physics_of_the_data(resampled):
    _, _, sampler, X, y = resampled
    made = (sampler.sample_origin_["origin"] == "pie") & (np.abs(X["v_x"]) > 0.5)
    truth = 0.8 * np.sign(X["v_x"]) + 0.02 * X["v_x"]
    assert made.sum() > 50
    assert np.sqrt(np.mean((y["curr_x"] - truth)[made] ** 2)) < 0.06


def test_the_same_seed_gives_the_same_bytes_and_the_inputs_are_not_touched():
    X, y = cuts(400)
    before = X.copy(), y.copy()
    sampler = PiDOSampler(MACHINE, density=200.0, random_state=1)
    first = sampler.fit_resample(X, y)
    second = clone(sampler).fit_resample(X, y)
    for a, b in zip(first, second, strict=True):
        pd.testing.assert_frame_equal(a, b, check_exact=True)
    pd.testing.assert_frame_equal(before[0], X)
    pd.testing.assert_frame_equal(before[1], y)


def test_only_bins_of_the_coming_part_are_filled():
    X, y = cuts(800)
    path = X[(X["v_x"] > 2) & (X["v_y"] > 0)]
    sampler = PiDOSampler(MACHINE, path, density=400.0, leverage_quantile=None, random_state=0)
    more, _ = sampler.fit_resample(X, y)
    made = more[sampler.sample_origin_["origin"] != "real"]
    assert len(made)
    assert set(zip(made["v_x"] // 2, made["v_y"] // 2, strict=True)) <= set(
        zip(path["v_x"] // 2, path["v_y"] // 2, strict=True)
    )


@pytest.mark.parametrize("kind", [pl.DataFrame, lambda frame: pa.Table.from_pandas(frame, preserve_index=False)])
def test_a_table_comes_out_as_the_kind_that_went_in(kind):
    X, y = cuts(300)
    plain_X, plain_y = PiDOSampler(MACHINE, density=100.0, random_state=0).fit_resample(X, y)
    more_X, more_y = PiDOSampler(MACHINE, density=100.0, random_state=0).fit_resample(kind(X), kind(y))
    assert type(more_X) is type(kind(X))
    assert type(more_y) is type(kind(y))
    np.testing.assert_array_equal(np.column_stack([more_X[c] for c in INPUTS]), plain_X[list(INPUTS)])
    np.testing.assert_array_equal(more_y[CURRENT["y"]], plain_y["curr_y"])


@pytest.mark.parametrize("kind", [pd.DataFrame, pl.DataFrame, lambda X: pa.Table.from_pandas(X, preserve_index=False)])
def test_the_names_that_went_in_come_out_and_a_model_of_the_rows_predicts_the_next_part(kind):
    X, y = cuts(300)
    X = X.rename(columns={"f_x_sim": "f_x", "mrr_sim": "materialremoved"}).assign(
        dir_x=np.sign(X["v_x"]), direction_y=np.sign(X["v_y"])
    )
    sampler = PiDOSampler(MACHINE, density=100.0, random_state=0)
    more_X, more_y = sampler.fit_resample(kind(X), kind(y))
    names = getattr(more_X, "column_names", None) or list(more_X.columns)
    assert list(names) == list(sampler.get_feature_names_out()) == list(sampler.feature_names_in_) == list(X.columns)
    if kind is pd.DataFrame:
        model = ExtraTreesRegressor(3, random_state=0).fit(more_X, more_y)
        assert model.predict(X).shape == y.shape
        assert LocalPhysicalEquations(MACHINE).fit(more_X, more_y).predict(X).shape == y.shape


def test_one_thing_under_two_names_is_refused():
    X, y = cuts(50)
    with pytest.raises(ValueError, match="direction_x stand in X under two names"):
        PiDOSampler(MACHINE).fit_resample(X.assign(dir_x=1.0, direction_x=1.0), y)
    with pytest.raises(RecordingError, match=r"twice in the table: \['f_x_sim'\]"):
        PiDOSampler(MACHINE).fit_resample(X.assign(f_x=0.0), y)


def test_it_works_in_a_pipeline_of_imbalanced_learn():
    X, y = cuts(600)
    model = make_pipeline(PiDOSampler(MACHINE, density=100.0, random_state=0), ExtraTreesRegressor(10, random_state=0))
    assert model.fit(X, y).score(*cuts(600, seed=1)) > 0.95


def test_what_it_cannot_use_is_refused_with_the_reason():
    X, y = cuts(50)
    with pytest.raises(ValueError, match="v_q"):
        PiDOSampler(MACHINE).fit_resample(X.rename(columns={"v_x": "v_q"}), y)
    with pytest.raises(ValueError, match="fill, none"):
        PiDOSampler(MACHINE, pie="everything").fit_resample(X, y)
    X.iloc[3, 0] = np.nan
    with pytest.raises(ValueError, match="NaN"):
        PiDOSampler(MACHINE).fit_resample(X, y)


def spindle(n=400):
    X, y = cuts(n)
    X["v_sp"] += 200 * np.sin(np.arange(n))
    return X, pd.DataFrame({"curr_sp": 1e-4 * X["v_sp"] + y["curr_x"]})


@pytest.mark.parametrize("method", ["adaptive", "paper"])
def test_a_column_that_knows_its_name_is_of_that_axis(method):
    X, y = spindle()
    options = {"method": method, "density": 200.0, "random_state": 0}
    _, table = PiDOSampler(MACHINE, **options).fit_resample(X, y)
    _, column = PiDOSampler(MACHINE, **options).fit_resample(X, y["curr_sp"])
    assert len(table) > len(X)
    pd.testing.assert_series_equal(column, table["curr_sp"], check_exact=True)
    both = [LocalPhysicalEquations(MACHINE).fit(X, each) for each in (y, y["curr_sp"])]
    assert both[0]._where == both[1]._where == [(3,)]


@pytest.mark.parametrize(
    "kind", [pd.Series, lambda v: pl.Series("curr_x", v), lambda v: pa.chunked_array([v]), lambda v: pa.array(v)]
)
def test_one_current_comes_out_as_the_column_that_went_in(kind):
    X, y = cuts(300)
    plain = PiDOSampler(MACHINE, density=100.0, random_state=0).fit_resample(X, y["curr_x"].to_numpy())[1]
    column = PiDOSampler(MACHINE, density=100.0, random_state=0).fit_resample(X, kind(y["curr_x"].to_numpy()))[1]
    assert type(column) is type(kind(y["curr_x"].to_numpy()))
    np.testing.assert_array_equal(np.asarray(column), plain)


@pytest.mark.parametrize("method", ["adaptive", "paper"])
@pytest.mark.parametrize("incomplete", ["drop", "nan"])
def test_an_axis_that_was_not_recorded_costs_the_others_no_row(method, incomplete):
    X, y = cuts(400)
    options = {"method": method, "density": 200.0, "incomplete": incomplete, "random_state": 0}
    _, alone = PiDOSampler(MACHINE, **options).fit_resample(X, y)
    sampler = PiDOSampler(MACHINE, **options)
    _, beside = sampler.fit_resample(X, y.assign(curr_z=np.nan))
    assert len(beside) > len(X)
    pd.testing.assert_frame_equal(beside[["curr_x", "curr_y"]], alone)
    assert beside["curr_z"].isna().all()


def test_the_report_counts_the_rows_that_are_returned():
    X, y = cuts(400)
    sampler = PiDOSampler(MACHINE, density=400.0, leverage_quantile=0.5, random_state=0)
    sampler.fit_resample(X, y.assign(curr_y=y["curr_y"] + 0.1 * X["a_y"]))
    report, origin = sampler.report_, sampler.sample_origin_["origin"]
    assert (report.pia.sum(), report.pie.sum()) == ((origin == "pia").sum(), (origin == "pie").sum())
    assert f"{(origin == 'pie').sum()} let through" in report.summary()


@pytest.mark.parametrize(
    ("options", "part", "error", "says"),
    [
        ({"incomplete": "foo"}, None, ValueError, "incomplete 'foo': it is 'drop' or 'nan'"),
        ({"density": np.inf}, None, FitError, "density inf: it must be positive and finite"),
        ({"leverage_quantile": 2.0}, None, FitError, r"quantile 2\.0: it lies above 0 and up to 1"),
        ({}, ["a"] * 3, ValueError, r"part has the shape \(3,\); it names the part of each of 50 rows"),
    ],
)
def test_options_without_a_meaning_are_refused_with_what_they_may_be(options, part, error, says):
    X, y = cuts(50)
    with pytest.raises(error, match=says):
        PiDOSampler(MACHINE, **options).fit_resample(X, y, part=part)


def test_currents_that_are_all_missing_are_refused():
    X, y = cuts(50)
    with pytest.raises(ValueError, match="contains NaN only"):
        PiDOSampler(MACHINE).fit_resample(X, y * np.nan)
