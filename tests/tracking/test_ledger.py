"""What the ledger says of arrivals that could not be used, and what `pido status` makes of it."""

from __future__ import annotations

import json
import sqlite3
from pathlib import Path

import pytest
from click.testing import CliRunner

from pido import departures
from pido.cli import pido
from pido.core.clock import utc
from pido.tracking.ledger import Ledger
from pido.workspace import Workspace


def names(ledger: Ledger) -> list[str]:
    return [arrival.name for arrival in ledger.rejections()]


@pytest.mark.parametrize(("machine", "stands"), [("m1", False), ("m2", True)])
def test_a_rejection_stands_until_a_later_arrival_of_its_name_and_machine_is_taken_in(tmp_path, machine, stands):
    ledger = Ledger(tmp_path / "ledger.db")
    ledger.took("before", "p1", "part 0", "m1")
    ledger.rejected("faulty", "p1", "no recording", "m1")
    ledger.took("other", "p2", "part 1", "m1")
    assert names(ledger) == ["p1"]
    ledger.took("mended", "p1", "part 2", machine)
    assert names(ledger) == (["p1"] if stands else [])
    ledger.rejected("faulty", "p1", "no recording", "m1")
    assert names(ledger) == ["p1"], "brought once more, it stands once more"


def test_a_ledger_of_an_older_version_is_brought_up_and_its_rejections_can_be_put_right(tmp_path):
    path = tmp_path / "ledger.db"
    Ledger(path).rejected("old", "p1", "no recording", "m1")
    with sqlite3.connect(path) as db:
        for table, column in (("arrivals", "machine"), ("arrivals", "lies"), ("iterations", "place")):
            db.execute(f"ALTER TABLE {table} DROP COLUMN {column}")
    ledger = Ledger(path)
    [old] = ledger.rejections()
    assert (old.machine, old.lies) == ("", "")
    ledger.took("mended", "p1", "part", "m1")
    assert ledger.rejections() == []


def test_status_says_when_and_of_which_machine_what_was_rejected_and_where_it_lies_now(tmp_path):
    place = Workspace.open(tmp_path / "plant")
    place.inbox.mkdir()
    bad = place.inbox / "p1"
    bad.write_text("{")
    reason = f"{bad}: no recording. {bad}/part.json is missing."
    departures.reject(place, bad, departures.key_of(bad), reason, move=True, machine="m1")
    [known] = Ledger(place.ledger).rejections()

    def status(*how: str) -> str:
        return CliRunner().invoke(pido, ["status", "--workspace", str(place.root), *how], catch_exceptions=False).output

    lies = place.store / "rejected" / "p1"
    said = f"rejected  {utc(known.at)}  m1  p1, now in {lies}: no recording. p1/part.json is missing."
    assert said in status().splitlines()
    [told] = json.loads(status("--json"))["rejected"]
    assert Path(told["lies"]) == lies
    assert str(place.inbox) not in status()
    lies.unlink()
    assert "now in" not in status(), "somebody has cleared it away"
