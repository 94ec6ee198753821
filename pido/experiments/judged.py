"""What a blind answer is worth once the truth is open.

In:  the claims of a solver, its scores and its correction of an unseen part; the sealed truth. Out: one row of figures.
"""

# pyright: reportAttributeAccessIssue=false, reportArgumentType=false

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from scipy.stats import rankdata

from pido.core.arrays import Bool1D, Float1D

_SAID = {
    ("coolant_load", "k"): "C",
    ("edge_force", "k"): "K_e",
    ("gravity_load", "k"): "G",
    ("load_dependent_friction", "k"): "mu",
    ("position_dependent_friction", "period_mm"): "L",
    ("presliding_hysteresis", "F_c"): "F_p",
    ("sensor_clipping", "limit"): "highest",
    ("sensor_gain", "gain"): "g - 1",
    ("sensor_offset", "offset"): "I_0",
    ("thermal_drift", "k"): "T",
    ("thermal_drift", "tau_s"): "tau",
    ("time_misalignment", "delay"): "shift",
    ("tool_wear", "k"): "W",
    ("torque_ripple", "period"): "L",
}
"""(mechanism, name in a truth) -> name in a finding, where the two say the same in other words."""

_LESS = {"gain": 1.0}
"""What a finding says less than the truth: a gain beyond one."""

_WEAR = "A per N (spindle: N·m) and 10 cm³"
_FACTOR = {
    "A·s/mm": {"A/(mm/s)": 1.0},
    "A·s²/mm": {"A/(mm/s²)": 1.0},
    "A·s/deg": {"A/(deg/s)": 1.0},
    "A·s²/deg": {"A/(deg/s²)": 1.0},
    "A·s²/deg²": {"A/(deg/s)²": 1.0},
    _WEAR: {"A/(cm³·N)": 0.1, "A/(cm³·N·m)": 0.1},
}


@dataclass(frozen=True)
class Interval:
    """95 % of a parameter."""

    low: float
    high: float
    unit: str


@dataclass(frozen=True)
class Claim:
    """What a solver says of one axis: the mechanism, its kind, and what it cannot tell from it, likeliest first."""

    axis: str
    mechanism: str
    kind: str
    alternatives: tuple[str, ...] = ()
    parameters: Mapping[str, Interval] | None = None


@dataclass(frozen=True, eq=False)
class Answer:
    """claims, strongest first; per part and axis the score in 0..1; for the unseen part the mismatch per axis, A."""

    claims: tuple[Claim, ...]
    scores: Mapping[str, Mapping[str, Float1D]]
    unseen: Mapping[str, Float1D]
    seconds: float


def judge(answer: Answer, truth: Mapping[str, Any], sealed: Path, unseen: str) -> dict[str, Any]:
    """What an answer is worth beside the truth.

    first, found : the first claim names an effect; all effects are among the claims; false : claims that name none.
    listed : an effect is the first claim or its first alternative
    auc : of the score on the truth's axis, where samples inside and outside the effect both exist
    removed : share of the effect's power that the correction takes from the unseen part
    covered, of : parameters whose 95 % interval holds the truth, and how many could be compared
    """
    effects = truth["effects"]
    real = [e for e in effects if e["mechanism"] != "time_misalignment" or e is effects[0]]
    claims = answer.claims
    found = [any(_names(c, e) for c in claims) for e in real]
    lead = next((e for e in real if claims and _names(claims[0], e)), None)
    row: dict[str, Any] = {
        "truth": ", ".join(f"{e['axis']} {e['mechanism']}" for e in real),
        "said": ", ".join(f"{c.axis} {c.mechanism}" for c in claims),
        "effects": len(real),
        "seconds": answer.seconds,
        "claims": len(claims),
        "false": sum(not any(_names(c, e) for e in real) for c in claims),
        "first": lead is not None if real else None,
        "found": all(found) if real else None,
        "listed": any(_names(claims[0], e) or _first_alternative(claims[0], e) for e in real) if real and claims
        else (False if real else None),
        "kind_right": any(claims[0].kind == e["kind"] for e in real) if real and claims else (False if real else None),
    }  # fmt: skip
    covered = [_covered(claim, e) for e in real for claim in claims if _names(claim, e)]
    row["covered"], row["of"] = (int(sum(c[k] for c in covered)) for k in (0, 1))
    physical = [e for e in real if e["kind"] != "data_fault"]
    if physical:
        axis = physical[0]["axis"]
        row["auc"] = _localised(answer, axis, sealed)
        effect = _sealed(sealed, unseen)[f"effect_{axis}"].to_numpy()
        power = float(np.mean(effect**2))
        guess = np.nan_to_num(answer.unseen.get(axis, np.zeros_like(effect)))  # what is not said corrects nothing
        row["removed"] = float(1 - np.mean((effect - guess) ** 2) / power) if power > 0 else None
    return row


def _names(claim: Claim, effect: Mapping[str, Any]) -> bool:
    """A clock is one for all axes; everything else is of one axis."""
    anywhere = effect["mechanism"] == "time_misalignment"
    return claim.mechanism == effect["mechanism"] and (anywhere or claim.axis == effect["axis"])


def _first_alternative(claim: Claim, effect: Mapping[str, Any]) -> bool:
    return claim.axis == effect["axis"] and claim.alternatives[:1] == (effect["mechanism"],)


def _covered(claim: Claim, effect: Mapping[str, Any]) -> tuple[int, int]:
    """How many intervals of a claim hold the truth, of how many that say the same quantity in the same unit.

    Sizes are compared: the truth has its coefficients positive, a finding has the sign by which it adds to the
    current. Of a wrong coefficient the truth says what is right, a finding what has to be added; of a clock that drifts
    the truth says the delay at the end, a finding that at the start: not comparable. An interval of no width holds what
    it is equal to but for rounding (a limit that was seen), or names a choice.
    """
    if claim.mechanism.startswith("miscalibrated:") or effect.get("shape", {}).get("drift"):
        return 0, 0
    hits = total = 0
    for name, parameter in effect["parameters"].items():
        said = (claim.parameters or {}).get(_SAID.get((claim.mechanism, name), name))
        factor = _factor(parameter["unit"], said.unit) if said is not None else None
        if said is None or factor is None or parameter["value"] is None:
            continue
        value = abs(parameter["value"] * factor - _LESS.get(name, 0.0))
        near = bool(np.isclose(value, [abs(said.low), abs(said.high)], rtol=1e-6).any())
        if said.low < said.high or near:
            total += 1
            hits += near or said.low <= value <= said.high or said.low <= -value <= said.high
    return hits, total


def _factor(truth: str, said: str) -> float | None:
    """By which a number in the one unit is multiplied to have the other; None where they measure different things.

    >>> _factor("A·s/mm", "A/(mm/s)"), _factor("A per N (spindle: N·m) and 10 cm³", "A/(cm³·N)"), _factor("A", "A/mm")
    (1.0, 0.1, None)
    """
    return 1.0 if truth == said else _FACTOR.get(truth, {}).get(said)


def _localised(answer: Answer, axis: str, sealed: Path) -> float | None:
    scores, inside = [], []
    for part, by_axis in answer.scores.items():
        acts = _sealed(sealed, part)[f"acts_{axis}"].to_numpy(bool)
        scores.append(np.nan_to_num(by_axis.get(axis, np.zeros(len(acts)))))
        inside.append(acts)
    return area_under_curve(np.concatenate(scores), np.concatenate(inside))


def area_under_curve(score: Float1D, inside: Bool1D) -> float | None:
    """Chance that a sample inside has a higher score than one outside, ties counted half; None if there is no both.

    >>> area_under_curve(np.array([0.1, 0.4, 0.35, 0.8]), np.array([False, False, True, True]))
    0.75
    """
    n, m = int(inside.sum()), int((~inside).sum())
    if not n or not m:
        return None
    return float((rankdata(score)[inside].sum() - n * (n + 1) / 2) / (n * m))


def _sealed(sealed: Path, part: str) -> pd.DataFrame:
    return pd.read_parquet(sealed / f"{part}.parquet")
