"""The published numbers that experiments stand beside, against each other and against the code that uses them."""

import numpy as np
import pytest

from pido.config import machine
from pido.core.axes import AXES
from pido.equations.weights import PAPER_KERNELS
from pido.experiments import paper
from pido.experiments.base import Unit
from pido.experiments.data import load_fleet
from pido.experiments.local_vs_global import GLOBAL, LOCAL
from pido.experiments.runner import measure
from pido.experiments.shares import MOST, PIA_SHARES, PIE_SHARES
from pido.experiments.weighting import BOUNDS
from pido.sampling.shares import paper_pia, paper_pie


def test_the_modal_values_of_table_2_are_the_kernels_of_the_paper_mode():
    for axis, kernel in zip(AXES, PAPER_KERNELS, strict=True):
        modes = [paper.TABLE_2[name][axis][1] for name in ("alpha", "beta", "sigma")]
        assert modes == [kernel.alpha, kernel.beta, kernel.sigma]


def test_table_2_lies_within_the_bounds_of_its_search():
    for name, (low, high) in BOUNDS.items():
        for mean, mode, median, spread in paper.TABLE_2[name].values():
            assert all(low <= v <= high for v in (mean, mode, median))
            assert spread < high - low


def test_a_polynomial_of_higher_order_never_fits_worse_in_table_3():
    rows = np.array([paper.TABLE_3[order] for order in range(1, 8)])
    assert (np.diff(rows[:, :2], axis=0) >= -1e-9).all()
    assert (np.diff(rows[:, 2:], axis=0) <= 1e-9).all()
    # R² and RMSE of one column belong to one spread: RMSE² / (1 - R²) is the same in every row
    spread = rows[:, 2:] ** 2 / (1 - rows[:, :2])
    np.testing.assert_allclose(spread, np.broadcast_to(spread[0], spread.shape), rtol=1e-4)


def test_local_equations_of_table_4_are_better_on_every_axis():
    for axis in AXES:
        assert paper.TABLE_4["local"][axis][0] < paper.TABLE_4["global"][axis][0]
        assert paper.TABLE_4["local"][axis][1] > paper.TABLE_4["global"][axis][1]


def test_share_functions_peak_inside_the_shares_that_were_tried():
    x = np.linspace(0, 100, 1001)
    assert paper_pie(x).max() <= max(PIE_SHARES) <= MOST
    assert paper_pia(x).max() <= max(PIA_SHARES)


@pytest.mark.slow
@pytest.mark.real
def test_global_and_local_errors_on_a_real_air_cut_are_those_found_by_other_means(real_data):
    path = real_data / "kit_dmc60h" / "S235JR_part2_aircut_1.csv"
    if not path.is_file():
        pytest.skip(f"{path} is missing")
    fleet = load_fleet(str(path), "impellers")
    assert fleet.machine == machine("dmc60h")
    found = {GLOBAL: [], LOCAL: []}
    for out in fleet.sets:
        params = {"split": "one left out", "train": [n for n in fleet.sets if n != out], "test": out}
        for row in measure("local-vs-global", fleet, 0, Unit(out, params)):
            if row["where"] == "all" and row["model"] in found and row["axis"] in "xy":
                found[row["model"]].append(row["rmse"])
    mean = {name: np.sqrt(np.mean(np.square(np.reshape(values, (3, 2))), axis=0)) for name, values in found.items()}
    np.testing.assert_allclose(mean[GLOBAL], [0.244, 0.196], rtol=0.03)
    np.testing.assert_allclose(mean[LOCAL], [0.178, 0.172], rtol=0.03)
