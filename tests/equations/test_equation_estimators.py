"""`PhysicalEquation` and `LocalPhysicalEquations` as scikit-learn regressors."""

import numpy as np
import pandas as pd
import polars as pl
import pyarrow as pa
import pytest
from sklearn.model_selection import GridSearchCV
from sklearn.utils.estimator_checks import parametrize_with_checks

from pido.equations.estimators import LocalPhysicalEquations, PhysicalEquation


@parametrize_with_checks([PhysicalEquation(), LocalPhysicalEquations()])
def test_scikit_learns_checks_pass(estimator, check):
    check(estimator)


def axis(n=2000, seed=0):
    rng = np.random.default_rng(seed)
    v = 40 * np.sin(np.linspace(0, 60, n))
    a = 80 * rng.normal(size=n)
    X = pd.DataFrame({"v_x": v, "a_x": a, "v_y": rng.normal(0, 20, n)})
    return X, 0.7 * np.sign(v) + 0.015 * v + 0.002 * a


def test_the_coefficients_are_those_of_the_current_in_its_own_units():
    X, current = axis()
    model = PhysicalEquation().fit(X, current)
    found = dict(zip(model.term_names_, model.coefficients_[0], strict=True))
    for term, value in {"held(v_x)": 0.7, "v_x": 0.015, "a_x": 0.002}.items():
        assert found[term] == pytest.approx(value, rel=0.02)
    assert model.score(X, current) > 0.999


def test_terms_that_no_row_excites_are_named():
    X, current = axis()
    dropped = PhysicalEquation().fit(X, current).dropped_
    assert {"v_z", "mrr_sim", "f_x_sim"} <= set(dropped)
    assert "v_x" not in dropped


def test_a_friction_that_depends_on_the_region_needs_local_equations():
    """Coulomb friction that is twice as large at slow speed: one set of coefficients cannot follow, one per bin can."""
    rng = np.random.default_rng(0)
    v = rng.uniform(-30, 30, 6000)
    current = np.where(np.abs(v) < 10, 1.0, 0.5) * np.sign(v)
    X = pd.DataFrame({"v_x": v})
    one = PhysicalEquation().fit(X[::2], current[::2])
    local = LocalPhysicalEquations(sigma=1.5, beta=0.002).fit(X[::2], current[::2])
    away = np.abs(np.abs(v[1::2]) - 10) > 3
    error = [np.sqrt(np.mean((m.predict(X[1::2]) - current[1::2])[away] ** 2)) for m in (one, local)]
    assert error[1] < 0.3 * error[0]


def test_an_axis_that_was_not_recorded_everywhere_is_fitted_on_its_own_rows():
    X, current = axis()
    y = np.column_stack([current, 2 * current])
    y[::2, 1] = np.nan
    model = PhysicalEquation().fit(X, y)
    np.testing.assert_allclose(model.coefficients_[1], 2 * model.coefficients_[0], atol=2e-3)


def test_the_standard_error_grows_beyond_the_samples():
    X, current = axis()
    X = X.assign(f_x_sim=0.0)
    model = LocalPhysicalEquations().fit(X, current + np.random.default_rng(1).normal(0, 0.1, len(X)))
    _, inside = model.predict(X, return_std=True)
    _, beyond = model.predict(X.assign(f_x_sim=500.0), return_std=True)
    assert (beyond > 10 * inside).all()


@pytest.mark.parametrize("flat", [True, False])
def test_the_standard_error_is_unknown_where_no_row_is_left_to_tell_the_noise_by(flat):
    X, current = axis()
    y = current if flat else np.column_stack([current, current])
    _, error = LocalPhysicalEquations().fit(X.iloc[:1], y[:1]).predict(X, return_std=True)
    assert error.shape == y.shape
    assert np.isnan(error).all()


@pytest.mark.parametrize("kind", [pl.DataFrame, lambda f: pa.Table.from_pandas(f, preserve_index=False), dict])
def test_tables_of_every_kind_give_the_same_equation(kind):
    X, current = axis(400)
    table = kind({k: v.to_numpy() for k, v in X.items()}) if kind is dict else kind(X)
    fitted = LocalPhysicalEquations().fit(table, current)
    assert list(fitted.feature_names_in_) == list(X.columns)
    np.testing.assert_array_equal(fitted.predict(table), LocalPhysicalEquations().fit(X, current).predict(X))


def test_terms_can_be_searched_like_any_parameter():
    X, current = axis()
    search = GridSearchCV(PhysicalEquation(), {"terms": ["constant", "paper", "held-small"]}, cv=3).fit(X, current)
    assert search.best_params_ == {"terms": "held-small"}
