"""What a truth says in numbers is what a reader of the recording finds in the effect, by the columns that are shown."""

import json
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from benchmarks.newcomer.draw import draw_case
from benchmarks.newcomer.folders import write_case
from benchmarks.newcomer.parts import Length
from benchmarks.newcomer.world import lagged
from benchmarks.sealed_truth import Task
from pido.core.arrays import Float1D
from pido.core.axes import LINEAR_AXES

SMALL = Length(parts=(3, 3), seconds=(25.0, 40.0), rows=40_000, fine_rows=40_000)
Column = Callable[[pd.DataFrame, str, str], Float1D]
"""(recording, axis, name of a parameter) -> what that parameter multiplies."""


def _turning(v: pd.Series) -> Float1D:
    """sgn(v) of a fast motion, not a number where a softened sign may still rise."""
    return np.where(np.abs(v) > 0.3 * np.abs(v).max(), np.sign(v), np.nan)


def _across(r: pd.DataFrame, axis: str, name: str) -> Float1D:
    """N: k of the load across the guideway, k_y of the size of f_y."""
    of = [a for a in LINEAR_AXES if a != axis] if name == "k" else [name.removeprefix("k_")]
    return np.linalg.norm(r[[f"f_{a}_sim" for a in of]], axis=1) * _turning(r[f"v_{axis}"])


EXACT, AS_SIMULATED = 0.02, 0.15
"""By how much an effect may differ: a simulated force is off by up to 14 % (`Kind.force_errors` times 1.4)."""

SAID: Mapping[str, tuple[Column, float]] = {
    "coulomb_friction": (lambda r, axis, _: _turning(r[f"v_{axis}"]), EXACT),
    "viscous_friction": (lambda r, axis, _: r[f"v_{axis}"].to_numpy(), EXACT),
    "load_dependent_friction": (_across, AS_SIMULATED),
    "inertia": (lambda r, axis, _: r[f"a_{axis}"].to_numpy(), EXACT),
    "cutting_force": (lambda r, axis, _: r[f"f_{axis}_sim"].to_numpy(), AS_SIMULATED),
    "coolant_load": (lambda r, axis, _: r["coolant"].to_numpy(), EXACT),
    "spindle_viscous_drag": (lambda r, axis, _: r["v_sp"].to_numpy(), EXACT),
    "spindle_windage": (lambda r, axis, _: (r["v_sp"] * np.abs(r["v_sp"])).to_numpy(), EXACT),
    "spindle_inertia": (lambda r, axis, _: r["a_sp"].to_numpy(), EXACT),
    "spindle_torque_load": (lambda r, axis, _: r["m_sp_sim"].to_numpy(), AS_SIMULATED),
}


@pytest.mark.parametrize("edition", [1, 3])
@pytest.mark.parametrize("law", SAID)
def test_the_parameters_of_a_truth_make_its_effect_of_the_columns_that_are_shown(law, edition, tmp_path: Path):
    case = draw_case(Task("single", law, 2.0, 3, edition), SMALL)
    places = write_case(case, tmp_path / "parts", tmp_path / "truth")
    (one,) = json.loads((tmp_path / "truth" / "truth.json").read_text(encoding="utf-8"))["effects"]
    machine, (column, tolerance) = case.parts[0].machine, SAID[law]
    effect, said = [], []
    for place in places:
        r, secret = (
            pd.read_parquet(p) for p in (place / "recording.parquet", tmp_path / f"truth/{place.name}.parquet")
        )
        of = [p["value"] * column(r, one["axis"], name) for name, p in one["parameters"].items()]
        current = np.sum(of, axis=0)
        behind = lagged(machine, np.nan_to_num(current), 1 / machine.rate)
        said.append(np.where(np.isfinite(current), behind, np.nan))
        effect.append(secret[f"effect_{one['axis']}"])
    said, effect = np.concatenate(said), np.concatenate(effect)
    large = np.abs(said) > 0.3 * np.nanquantile(np.abs(said), 0.99)  # of what is not a number nothing is
    ratio = effect[large] / said[large]
    assert np.quantile(ratio, [0.1, 0.9]) == pytest.approx([1.0, 1.0], abs=tolerance)
