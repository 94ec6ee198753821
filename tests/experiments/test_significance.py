"""Paired tests and their correction, against scipy and statsmodels."""

import numpy as np
import pandas as pd
import pytest
from scipy import stats
from statsmodels.stats.multitest import multipletests

from pido.experiments.compare import beside, by_step, changes_tested, counts, differences
from pido.experiments.significance import corrected, paired_p


def test_normal_differences_get_the_t_test_and_skewed_ones_the_signed_rank_test():
    rng = np.random.default_rng(1)
    normal, skewed = stats.norm.ppf((np.arange(30) + 0.5) / 30) + 0.2, rng.exponential(1.0, 30) ** 3 - 0.5
    assert paired_p(normal) == (pytest.approx(stats.ttest_rel(normal, np.zeros(30)).pvalue), "t")
    p, name = paired_p(skewed)
    assert name == "Wilcoxon"
    assert p == pytest.approx(stats.wilcoxon(skewed).pvalue)


@pytest.mark.parametrize(("how", "name"), [("holm", "holm"), ("bh", "fdr_bh")])
def test_corrections_are_those_of_statsmodels(how, name):
    p = np.random.default_rng(0).random(40) ** 3
    np.testing.assert_allclose(corrected(p, how), multipletests(p, method=name)[1], atol=1e-12)


def test_where_nothing_differs_hardly_any_family_of_tests_finds_something():
    rng = np.random.default_rng(2)
    found = sum(
        (corrected(np.array([paired_p(rng.normal(size=12))[0] for _ in range(10)])) < 0.05).any() for _ in range(60)
    )
    assert found <= 9  # 5 % of 60 are 3; more than 9 has a chance of 0.001


def errors() -> pd.DataFrame:
    rows = []
    rng = np.random.default_rng(0)
    for repeat in range(12):
        base = rng.uniform(0.9, 1.1)
        for variant, factor in (("real", 1.0), ("half", 0.5), ("same", 1.0)):
            noise = rng.normal(0, 1e-3) if variant != "real" else 0.0
            rows.append(
                {"scenario": "files", "repeat": repeat, "step": 1, "space": "C", "axis": "x", "variant": variant,
                 "baseline": "real", "rmse": base * factor + noise}
            )  # fmt: skip
    return pd.DataFrame(rows)


def test_differences_are_paired_within_a_repeat_and_positive_is_better():
    half = differences(errors()).query("variant == 'half'")
    np.testing.assert_allclose(half["delta"], 0.5 * half["base"], atol=5e-3)


def test_a_halved_error_is_counted_as_a_significant_improvement_and_noise_is_not():
    result = changes_tested(errors())
    number = counts(result).set_index("variant")
    assert number.loc["half", "better, corrected"] == 1
    assert number.loc["same", ["better, corrected", "worse, corrected"]].tolist() == [0, 0]
    assert result.set_index("variant").loc["half", "change"] == pytest.approx(50, abs=1)


def test_a_variant_beside_two_baselines_has_a_column_and_a_count_for_each_that_names_it():
    table = errors()
    rich = table[table.variant == "real"].assign(variant="rich", baseline="rich")
    poor = rich.assign(variant="none", baseline="none", rmse=2 * rich.rmse)
    own = table[table.variant == "half"].assign(variant="PiDO", baseline="rich")
    result = changes_tested(beside(pd.concat([rich, poor, own]), "PiDO", "none"))
    assert by_step(result).columns[-2:].tolist() == ["PiDO against rich", "PiDO against none"]
    assert counts(result)[["variant", "against"]].values.tolist() == [["PiDO", "rich"], ["PiDO", "none"]]
    assert result.change.tolist() == pytest.approx([50.0, 75.0], abs=1)
    assert beside(own, "PiDO", "none") is own
