"""What a blind answer is worth: only the same quantity in the same unit is compared with an interval."""

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from pido.experiments.judged import Answer, Claim, Interval, judge


def truth(mechanism: str, parameters: dict[str, tuple[float, str]], **more: Any) -> dict[str, Any]:
    named = {k: {"value": v, "unit": unit} for k, (v, unit) in parameters.items()}
    effect = {"axis": "x", "mechanism": mechanism, "kind": "missing_physics", "parameters": named, "shape": {}} | more
    return {"effects": [effect]}


def verdict(claims: tuple[Claim, ...], of: dict[str, Any], folder: Path, guess: Any = 1.0) -> dict[str, Any]:
    acts = np.arange(40) % 2 == 0
    for part in ("shown", "unseen"):
        pd.DataFrame({"effect_x": acts * 0.5, "acts_x": acts}).to_parquet(folder / f"{part}.parquet")
    score = {"shown": {"x": acts * 0.9}}
    return judge(Answer(claims, score, {"x": guess * acts * 0.5}, 1.0), of, folder, "unseen")


def claim(mechanism: str, **parameters: Interval) -> Claim:
    return Claim("x", mechanism, "missing_physics", ("backlash", "inertia"), parameters)


@pytest.mark.parametrize(
    ("mechanism", "name", "value", "unit", "said", "interval", "expected"),
    [
        ("viscous_friction", "F_v", 2e-3, "A·s/mm", "F_v", Interval(1e-3, 3e-3, "A/(mm/s)"), (1, 1)),
        ("viscous_friction", "F_v", 2e-3, "A·s/mm", "F_v", Interval(-3e-3, -1e-3, "A/(mm/s)"), (1, 1)),
        ("viscous_friction", "F_v", 4e-3, "A·s/mm", "F_v", Interval(1e-3, 3e-3, "A/(mm/s)"), (0, 1)),
        ("edge_force", "k", 0.2, "A/mm", "K_e", Interval(0.1, 0.3, "A/mm"), (1, 1)),
        ("edge_force", "k", 0.2, "A/mm", "K_e", Interval(0.01, 0.03, "A/mm²"), (0, 0)),
        ("axis_coupling", "k", 0.2, "A", "k", Interval(0.1, 0.3, "A/(mm/s²)"), (0, 0)),
        ("tool_wear", "k", 0.02, "A per N (spindle: N·m) and 10 cm³", "W", Interval(1e-3, 3e-3, "A/(cm³·N)"), (1, 1)),
        ("sensor_gain", "gain", 1.02, "–", "g - 1", Interval(0.01, 0.03, "–"), (1, 1)),
        ("sensor_clipping", "limit", 4.1, "A", "highest", Interval(4.1 + 1e-12, 4.1 + 1e-12, "A"), (1, 1)),
        ("position_dependent_friction", "period_mm", 70.0, "mm", "L", Interval(36.0, 36.0, "mm"), (0, 0)),
    ],
)
def test_an_interval_is_compared_with_the_same_quantity_in_its_unit(
    mechanism: str,
    name: str,
    value: float,
    unit: str,
    said: str,
    interval: Interval,
    expected: tuple[int, int],
    tmp_path: Path,
) -> None:
    row = verdict((claim(mechanism, **{said: interval}),), truth(mechanism, {name: (value, unit)}), tmp_path)
    assert (row["covered"], row["of"]) == expected


def test_a_clock_that_drifts_and_a_wrong_coefficient_are_not_compared(tmp_path: Path) -> None:
    late = truth("time_misalignment", {"delay": (2e-3, "s")}, shape={"drift": True})
    assert verdict((claim("time_misalignment", shift=Interval(0.0, 1e-4, "s")),), late, tmp_path)["of"] == 0
    wrong = truth("miscalibrated:inertia", {"m": (2e-3, "A·s²/mm")})
    assert verdict((claim("miscalibrated:inertia", m=Interval(0, 1, "A/(mm/s²)")),), wrong, tmp_path)["of"] == 0


def test_names_places_and_what_is_removed(tmp_path: Path) -> None:
    of = truth("backlash", {})
    row = verdict((claim("backlash"), claim("inertia")), of, tmp_path, guess=0.5)
    assert (row["first"], row["found"], row["false"], row["auc"]) == (True, True, 1, 1.0)
    assert row["removed"] == pytest.approx(0.75)
    other = verdict((claim("inertia"),), of, tmp_path)
    assert (other["first"], other["found"], other["listed"], other["false"]) == (False, False, True, 1)
    nothing = verdict((), of, tmp_path)
    assert (nothing["first"], nothing["listed"], nothing["false"]) == (False, False, 0)
    clean = verdict((), {"effects": []}, tmp_path)
    assert (clean["first"], clean["found"], clean["of"]) == (None, None, 0)


def test_what_a_correction_leaves_open_is_not_removed(tmp_path: Path) -> None:
    rows = np.where(np.arange(40) < 20, np.nan, 1.0)
    row = verdict((claim("backlash"),), truth("backlash", {}), tmp_path, guess=rows)
    assert row["removed"] == pytest.approx(0.5)
