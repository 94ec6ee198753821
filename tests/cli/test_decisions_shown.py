"""What a person wrote cannot look like a decision, and a page says what became of its version."""

from __future__ import annotations

import re
from pathlib import Path

import pandas as pd
import pytest

from pido.tracking import bundle, promotion
from pido.tracking.ledger import Ledger
from pido.tracking.report_files import RunFiles
from pido.workspace import Workspace

MACHINE = "m1"
FORGED = "worn\n  2026-01-01T00:00:00+00:00  approve 3 by B. Ruiz: fine\r\x1b[2J\u2028x"


@pytest.fixture
def plant(tmp_path) -> Workspace:
    """Four versions, the last of which did not pass its gate."""
    place = Workspace.open(tmp_path / "plant")
    for number in (1, 2, 3, 4):
        made = bundle.save(place.bundles, {"machine": MACHINE, "parts": [f"p{number}"]}, {"x.skops": b"x"})
        gate = {"passed": number < 4, "words": "no axis is worse"}
        summary = {
            "run_key": f"run{number}", "machine": MACHINE, "part": {"digest": f"p{number}", "name": f"part {number}"},
            "parts": ["p1"], "settings": {}, "seed": 0, "code": "0", "bundle": made.digest, "data": {
                n: {"digest": n, "rows": 1} for n in ("real", "pia", "pie")}, "metrics": {}, "gate": gate,
            "balance": {"before": 9.0, "after": 4.0, "relevant_bins": 0}, "seconds": {},
        }  # fmt: skip
        nothing = pd.DataFrame({name: pd.Series(dtype=float) for name in ("v_x", "v_y", "ar", "before", "after")})
        generated, trace = nothing.assign(origin=pd.Series(dtype=str)), pd.DataFrame({"time": pd.Series(dtype=float)})
        RunFiles(summary, generated, nothing, trace).save(place.runs)
        known = {k: summary[k] for k in ("part", "metrics", "gate", "balance")}
        Ledger(place.ledger).finished(f"run{number}", MACHINE, f"p{number}", f"part {number}", made.digest, gate, known)
    return place


def test_a_reason_stays_in_its_line_and_a_name_is_one_line(call, plant):
    where = ["-w", plant.root]
    code, out, err = call("reject", 1, "--by", "A.\n  2026 approve 3 by B", "--reason", "why", "--no-mirror", *where)
    assert (code, out) == (1, "")
    assert "a name is one line" in err
    assert len(err.splitlines()) == 1
    assert promotion.history(plant, MACHINE) == []
    code, out, _ = call("reject", 1, "--by", "A. Ito", "--reason", FORGED, "--no-mirror", *where)
    assert code == 0
    assert len(out.splitlines()) == 1
    code, out, _ = call("status", "--history", *where)
    decisions = [line for line in out.splitlines() if re.match(r"\s*\d{4}-", line)]
    assert len(decisions) == 1
    assert "worn\\n  2026-01-01T00:00:00+00:00  approve 3" in decisions[0]
    assert "\x1b" not in out
    assert promotion.history(plant, MACHINE)[0].reason == FORGED, "what was written is kept"


def test_names_and_reasons_of_what_was_rejected_or_waits_stay_apart_from_decisions(call, plant):
    line = "  2026-01-01T00:00:00+00:00  approve 3 by B: fine"
    Ledger(plant.ledger).rejected("k1", f"p\n{line}", f"2 faults:\n{line}\n  and more")
    known = "p: not a recording that is known here. Known are:\n  csv: with a header\n  hfdata: with packets"
    Ledger(plant.ledger).rejected("k2", "p", known)
    _, out, _ = call("status", "--history", "-w", plant.root)
    assert not any(re.match(r" {0,3}\d{4}-", shown) for shown in out.splitlines())
    assert f"    {line}" in out.splitlines()
    assert "not a recording that is known here." in out
    assert "hfdata" not in out, "the formats lie beside the file"


def said_of(call, plant: Workspace, version: int, out: Path) -> str:
    code, _, err = call("report", "iteration", "--version", version, "-w", plant.root, "--out", out)
    assert code == 0, err
    return out.read_text(encoding="utf-8")


def test_the_page_of_a_version_says_what_became_of_it(call, plant, tmp_path):
    def says(version: int) -> str:
        return said_of(call, plant, version, tmp_path / "page.html")

    who = {"by": "A. Ito", "reason": "tool was worn"}
    assert "this version is superseded" in says(1)
    assert "this version is not offered for approval" in says(4)
    promotion.approve(plant, MACHINE, 1, **who)
    promotion.approve(plant, MACHINE, 2, **who)
    promotion.reject(plant, MACHINE, 3, **who)
    for version, words in ((1, "was in force, and another one is now"), (2, "this version is in force (by A. Ito"),
                           (3, "this version was rejected and stays so (by A. Ito")):  # fmt: skip
        page = says(version)
        assert words in page
        assert "may be approved" not in page
