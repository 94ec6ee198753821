"""kill -9 at random moments of approvals and rollbacks: all of a decision or nothing of it, and no hand work after."""

from __future__ import annotations

import random

from benchmarks.chaos_storm import promotions
from pido.tracking import bundle
from pido.tracking.ledger import Ledger
from pido.workspace import Workspace

MACHINE = "m1"


def test_a_promotion_that_is_killed_leaves_one_whole_version_in_force_and_every_decision_once(tmp_path):
    place = Workspace.open(tmp_path / "plant")
    for number in (1, 2, 3):
        models = {f"{axis}.skops": f"{axis}{number}".encode() * 1000 for axis in ("x", "y", "z", "sp")}
        made = bundle.save(place.bundles, {"machine": MACHINE, "parts": [f"p{number}"]}, models)
        gate = {"passed": True, "words": "no axis is worse"}
        Ledger(place.ledger).finished(f"run{number}", MACHINE, f"p{number}", f"part {number}", made.digest, gate, {})
    found = promotions(place, MACHINE, 40, random.Random(0), tmp_path / "attempts.log")
    assert found.faults == 40
    assert (found.lost, found.doubled, found.same) == (0, 0, True)
