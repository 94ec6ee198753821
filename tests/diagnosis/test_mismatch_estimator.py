"""`MismatchCorrection` as a scikit-learn regressor."""

import numpy as np
import pandas as pd
import polars as pl
import pytest
from sklearn.base import clone
from sklearn.utils.estimator_checks import parametrize_with_checks

from pido.diagnosis.estimator import MismatchCorrection

NEEDS_A_RECORDING = "its data are arrays without names and time; a diagnosis needs a recording in time order, by name"
ON_ARRAYS = (
    "check_fit_score_takes_y", "check_estimators_overwrite_params", "check_dont_overwrite_parameters",
    "check_estimators_fit_returns_self", "check_readonly_memmap_input", "check_n_features_in_after_fitting",
    "check_positive_only_tag_during_fit", "check_estimators_dtypes", "check_complex_data", "check_dtype_object",
    "check_estimators_empty_data_messages", "check_pipeline_consistency", "check_estimators_nan_inf",
    "check_estimator_sparse_tag", "check_estimator_sparse_array", "check_estimator_sparse_matrix",
    "check_estimators_pickle", "check_f_contiguous_array_estimator", "check_regressors_train",
    "check_regressor_data_not_an_array", "check_regressors_no_decision_function", "check_supervised_y_2d",
    "check_regressors_int", "check_methods_sample_order_invariance", "check_methods_subset_invariance",
    "check_fit2d_1sample", "check_fit2d_1feature", "check_dict_unchanged", "check_fit_idempotent",
    "check_fit_check_is_fitted", "check_n_features_in", "check_fit2d_predict1d",
)  # fmt: skip


@parametrize_with_checks(
    [MismatchCorrection()], expected_failed_checks=lambda _: dict.fromkeys(ON_ARRAYS, NEEDS_A_RECORDING)
)
def test_scikit_learns_checks_pass(estimator, check):
    check(estimator)


def part(name, seed):
    """An axis that goes to and fro at several feeds; its simulation knows no friction that grows with speed."""
    rng = np.random.default_rng(seed)
    t = np.arange(0, 60, 0.02)
    v = np.repeat(rng.choice([-12.0, -6.0, -2.0, 2.0, 6.0, 12.0], 60), 50)
    v = np.convolve(v, np.ones(9) / 9, mode="same")
    simulated = 0.5 * np.sign(v)
    X = pd.DataFrame(
        {
            "time": t, "pos_x": np.cumsum(v) * 0.02, "v_x": v, "a_x": np.gradient(v, t), "curr_x_sim": simulated,
            "part": name,
        }
    )  # fmt: skip
    return X, simulated + 0.03 * v + rng.normal(0, 0.03, len(t))


@pytest.fixture(scope="module")
def parts():
    made = [part(f"p{k}", k) for k in range(4)]
    return made


@pytest.fixture(scope="module")
def fitted(parts):
    X = pd.concat([x for x, _ in parts[:3]], ignore_index=True)
    return MismatchCorrection().fit(X, np.concatenate([y for _, y in parts[:3]])), X


def test_it_names_what_is_missing(fitted):
    assert [f.mechanism for f in fitted[0].diagnosis_.findings] == ["viscous_friction"]


def test_a_part_that_was_not_seen_is_predicted_to_its_noise(fitted, parts):
    X, y = parts[3]
    predicted = fitted[0].predict(X)
    assert np.sqrt(np.mean((predicted - y) ** 2)) < 1.1 * 0.03
    assert np.sqrt(np.mean((X["curr_x_sim"] - y) ** 2)) > 5 * 0.03


def test_predictions_are_the_same_from_another_library_and_after_a_copy(fitted, parts):
    model, _ = fitted
    X = parts[3][0]
    np.testing.assert_array_equal(model.predict(pl.DataFrame(X)), model.predict(X))
    assert clone(model).get_params() == model.get_params()


def test_what_cannot_be_compared_is_refused_with_the_reason(parts):
    X, y = parts[0]
    with pytest.raises(ValueError, match="column names"):
        MismatchCorrection().fit(X.drop(columns="part").to_numpy(), y)
    with pytest.raises(ValueError, match="time"):
        MismatchCorrection().fit(X.drop(columns="time"), y)
