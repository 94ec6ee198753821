"""The gate at the edge: a challenger beside the champion in force, on parts that neither had been trained on.

In:  a workspace, a challenger's parts and how it was made. Out: the gate's verdict, as plain values.

The challenger's error on a part is that of models made in the same way without it, as they stood when the part came:
the ledger has it. What was made in another way says nothing of this challenger and is not used, nor what was measured
on other rows than the champion can be measured on now: an alarm answered since takes its rows out of a part. A part
that is withdrawn judges nothing, nor do errors of models that had learnt from one.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from pido.core.arrays import Float1D
from pido.core.axes import AXES
from pido.core.errors import RegistryError
from pido.core.samples import Samples
from pido.models.axis_models import AxisModels
from pido.models.metrics import metrics
from pido.models.promotion import covered, gate, open_alarms
from pido.models.rivals import RIVALS
from pido.parts import at_rate, samples_of
from pido.store import Store
from pido.supervision.book import Book
from pido.tracking import bundle, model_files, promotion
from pido.tracking.ledger import Iteration, Ledger, Version
from pido.tracking.report_files import foretold_at
from pido.tracking.withdrawn import withdrawn
from pido.workspace import Workspace, code_version

Making = dict[str, Any]
"""How models are made: digest of the settings, seed, code, and names of the accepted physics in their equations."""


def models_in(found: bundle.Bundle) -> AxisModels:
    """The four models of a bundle; every file is checked before it is opened."""
    loaded = {a: model_files.load(found.read(f"{a}.skops")) for a in AXES if f"{a}.skops" in found.files}
    return AxisModels(loaded, found.content["inputs"], found.content["seed"])


def making_of(workspace: Workspace, machine: str, physics: list[str]) -> Making:
    """How the workspace makes models of a machine now. physics : names of what is accepted"""
    settings = workspace.settings
    return {"settings": workspace.settings_digest(machine), "seed": settings.seed, "code": code_version(),
            "physics": sorted(physics)}  # fmt: skip


def judge_again(workspace: Workspace, version: Version) -> dict[str, Any]:
    """The gate's verdict on a version beside the champion that is in force now; nothing is written."""
    content = bundle.load(workspace.bundles, version.bundle).content
    order = [e.digest for e in Store(workspace.store).entries() if e.digest in set(content["parts"])]
    made = Ledger(workspace.ledger).iteration(version.run_key)
    if made is None:
        raise RegistryError(f"{version.machine} version {version.version} has no iteration in {workspace.ledger}.")
    return verdict(workspace, version.machine, order, _making(made, content), {})


def verdict(
    workspace: Workspace, machine: str, parts: list[str], making: Making, measured: dict[str, Any]
) -> dict[str, Any]:
    """The gate, on the last parts that neither challenger nor champion had been trained on.

    parts, making : the challenger's, its parts in production order
    measured : by part, metrics of the arriving one, which are not in the ledger yet
    """
    now = promotion.champion_bundle(workspace, machine)
    learnt = set() if now is None else set(Store(workspace.store).today(now.content["parts"]).values())
    history, gone = _History(workspace, machine, making), withdrawn(workspace, machine)
    usable: dict[str, Any] = {}
    otherwise = 0
    for digest in reversed(parts):
        if digest in learnt or digest in gone or len(usable) == workspace.settings.gate_parts:
            continue
        found = measured[digest] if digest in measured else history.of(digest)
        if found:
            usable[digest] = found
        else:
            otherwise += digest in history.measured
    if not usable:
        when = "trained on" if now is None else "trained on for the present champion"
        same = (
            " and was foretold on the same rows, with the same settings, code and accepted physics" if otherwise else ""
        )
        return {"passed": False, "words": f"no part yet that was not {when}{same}; the next part decides"}

    def rmse(variant: str) -> dict[str, np.ndarray]:
        return {d: np.array([_number(found, a, variant) for a in AXES]) for d, found in usable.items()}

    theirs: dict[str, np.ndarray] = {}
    if now is not None:
        champion = models_in(now)
        for digest in usable:
            path = samples_of(workspace, digest)
            found = metrics(path.currents, champion.predict(path))
            theirs[digest] = np.array([found[axis].rmse for axis in AXES])
    others = {name: rmse(name) for name in RIVALS if name != "constant"}
    mine = rmse("both")
    earlier = {
        d: history.before(d, parts) | {p: mine[p] for p in mine if parts.index(p) < parts.index(d)} for d in mine
    }
    alarmed = alarmed_shares(workspace, machine, list(usable))
    said = gate(mine, theirs, rmse("constant"), others=others, alarmed=alarmed, earlier=earlier)
    return {"passed": bool(said.passed), "words": said.words, "parts": list(usable)[::-1],
            "champion": None if now is None else now.digest, "warnings": list(said.warnings),
            "alarms": list(said.alarms), "doubts": list(said.doubts),
            "change": {a.axis: a.change for a in said.axes}}  # fmt: skip


def alarms_now(workspace: Workspace, version: Version) -> tuple[str, tuple[str, ...]]:
    """(Why nobody may approve `version` before the alarms on its gate's parts are answered, or ''; what is to be said
    of them all the same). A monitor may have spoken since the gate did."""
    parts = version.gate.get("parts", [])
    shares = alarmed_shares(workspace, version.machine, parts)
    full = covered(parts, shares)
    axes = ", ".join(f"{axis} {share:.0%}" for axis, share in full.items())
    why = (
        f"{version.machine} version {version.version}: alarms that nobody has answered cover more than half of the "
        f"part(s) that its gate judged it by ({axes}), so nothing is known of it there. Say what they were (`pido "
        "monitor answer`), or take the part out (`pido withdraw`)."
    )
    return (why if full else ""), open_alarms(parts, shares)


def alarmed_shares(workspace: Workspace, machine: str, parts: list[str]) -> dict[str, Float1D]:
    """By part that has open alarms: share (4,) of its rows with a current that lie in one, NaN without a current."""
    by_part: dict[str, list[Any]] = {}
    for alarm in Book(workspace, machine).open_alarms():
        by_part.setdefault(alarm.part, []).append(alarm)
    found = {}
    for part in parts:
        if part not in by_part:
            continue
        rows = samples_of(workspace, part)
        time = at_rate(workspace, Store(workspace.store).load(part, ())).time[rows.row]
        known = np.isfinite(rows.currents)
        inside = np.zeros(known.shape, bool)
        for alarm in by_part[part]:
            inside[(time >= alarm.t_start) & (time <= alarm.t_end), AXES.index(alarm.axis)] = True
        n = known.sum(axis=0)
        found[part] = np.where(n > 0, (inside & known).sum(axis=0) / np.maximum(n, 1), np.nan)
    return found


class _History:
    """What iterations of a machine measured, where they made models as the challenger was made."""

    def __init__(self, workspace: Workspace, machine: str, making: Making) -> None:
        ledger = Ledger(workspace.ledger)
        self._workspace, self._making = workspace, making
        self._bundles = {v.version: v.bundle for v in ledger.versions(machine)}
        self._done = [one for one in ledger.iterations(machine) if one.summary.get("metrics")]
        self.measured = {one.part for one in self._done}
        self._spoilt = promotion.trained_on_withdrawn(workspace, machine)

    def of(self, part: str) -> dict[str, Any] | None:
        """Metrics of a part by its newest iteration that counts, or None."""
        mine = (one for one in reversed(self._done) if one.part == part)
        return next((one.summary["metrics"] for one in mine if self._counts(one)), None)

    def before(self, part: str, order: list[str]) -> dict[str, Float1D]:
        """What models of the day were wrong by on the parts before `part`, of those that `order` has."""
        earlier = set(order[: order.index(part)])
        return {
            one.part: np.array([_number(one.summary["metrics"], axis, "both") for axis in AXES])
            for one in self._done
            if one.part in earlier and one.version not in self._spoilt
        }

    def _counts(self, one: Iteration) -> bool:
        if one.version in self._spoilt:
            return False
        digest = self._bundles[one.version]
        # Of a bundle that somebody has cleared away nobody can say how it was made.
        there = (self._workspace.bundles / digest).exists()
        made = there and _making(one, bundle.load(self._workspace.bundles, digest).content) == self._making
        return made and np.array_equal(
            foretold_at(self._workspace.runs, one.run_key),
            clock(self._workspace, samples_of(self._workspace, one.part)),
        )


def clock(workspace: Workspace, path: Samples) -> Float1D:
    """When the rows of a part were, s, by their number: with it an iteration writes down what it said of which."""
    return path.row / workspace.settings.rate_hz


def _making(one: Iteration, content: dict[str, Any]) -> Making:
    """How the models of an iteration were made. content : of its bundle"""
    physics = one.summary.get("physics", {}).get("accepted", [])
    return {name: content.get(name) for name in ("settings", "seed", "code")} | {"physics": physics}


def _number(measured: dict[str, Any], axis: str, variant: str) -> float:
    value = measured.get(axis, {}).get(variant, {}).get("rmse")
    return float("nan") if value is None else float(value)
