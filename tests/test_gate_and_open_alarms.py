"""A version judged by a part that the monitor is full of: said everywhere, and not approved before it is answered."""

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from plain_parts import parts as made_up

from pido import plain, production
from pido.approval import approve, doubts, refusal
from pido.cli import pido
from pido.comparison import alarmed_shares, judge_again
from pido.core.errors import RegistryError
from pido.monitoring.alarms import Alarm
from pido.parts import samples_of
from pido.recordings.folder import write_folder
from pido.reports.iteration import verdict as on_the_page
from pido.supervision.book import Book, alarm_id
from pido.tracking.ledger import Ledger, Version
from pido.workspace import Workspace

MACHINE = "cmx600v"
SETTINGS = "compare = false\n[method]\nadaptive = false\ncompare_with_model = false\n"
AXES = ("x", "y", "z", "sp")
ODD = 15.0
"""Times the currents of the others: below what is refused at arrival."""


@pytest.fixture(scope="module")
def made(tmp_path_factory) -> Path:
    """A workspace with two parts, and a third one that draws far more."""
    root = tmp_path_factory.mktemp("made")
    (root / "workspace.toml").write_text(SETTINGS)
    first, second, third = (part.rows(slice(0, 700)) for part in made_up(3))
    odd = third.with_columns(**{c: ODD * third[c] for c in third.columns if c.startswith("curr_")})
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(production, "log", lambda root: {"logged": 0, "fault": ""})
        for part in (first, second, odd):
            folder = write_folder(part, tmp_path_factory.mktemp("part") / part.part.part)
            assert not plain.run(Workspace.open(root), [folder], None, lambda done, total, what: None)["rejected"]
    return root


@pytest.fixture
def plant(made, tmp_path) -> Workspace:
    """As a reviewer found one: the newest version has passed a gate that judged it by the odd part alone."""
    shutil.copytree(made, tmp_path / "ws")
    workspace = Workspace.open(tmp_path / "ws")
    version = newest(workspace)
    gate = {**version.gate, "passed": True, "words": "may be promoted", "parts": [odd_part(workspace)]}
    Ledger(workspace.ledger).judged(MACHINE, version.version, {**gate, "alarms": [], "doubts": []})
    return workspace


def newest(workspace: Workspace) -> Version:
    return Ledger(workspace.ledger).versions(MACHINE)[-1]


def odd_part(workspace: Workspace) -> str:
    return Ledger(workspace.ledger).parts(MACHINE)[-1]


def raise_alarms(workspace: Workspace, share: float) -> list[str]:
    """On every axis, over the first `share` of the odd part's rows."""
    part, book = odd_part(workspace), Book(workspace, MACHINE)
    rows = samples_of(workspace, part)
    start, end = rows.row[0] / 50.0, rows.row[int(share * (len(rows) - 1))] / 50.0
    named = [(alarm_id(MACHINE, part, a), a) for a in (Alarm(part, x, start, end, "", 3, 9.0, 9.0) for x in AXES)]
    said = [{"id": i, "part": "demo-03", "axis": a.axis, "t_start": start, "t_end": end, "tool": "", "block": 3,
             "size_a": 9.0, "spreads": 9.0, "looks_like": "unknown"} for i, a in named]  # fmt: skip
    book.verdict({"part": "demo-03", "digest": part, "good": False, "alarms": said})
    return [i for i, _ in named]


def call(workspace: Workspace, *words: str):
    return CliRunner().invoke(pido, [*words, "-w", str(workspace.root)])


def approved(workspace: Workspace):
    who = ("--by", "A. Ito", "--reason", "looks good", "--no-mirror")
    return call(workspace, "approve", str(newest(workspace).version), *who)


def test_a_version_judged_by_a_part_full_of_open_alarms_is_not_approved_before_they_are_answered(plant):
    names = raise_alarms(plant, 0.8)
    with pytest.raises(RegistryError, match=r"more than half .*x 80%.*pido monitor answer"):
        approve(plant, MACHINE, newest(plant).version, by="A. Ito", reason="looks good")
    assert "pido withdraw" in refusal(plant, newest(plant))
    for name in names:
        Book(plant, MACHINE).answer(name, true=False, by="A. Ito", reason="a heavier part")
    assert refusal(plant, newest(plant)) == ""
    assert approved(plant).exit_code == 0


def test_a_share_of_open_alarms_is_said_by_status_and_at_the_approval(plant):
    assert "unanswered" not in call(plant, "status").stdout
    raise_alarms(plant, 0.3)
    told = call(plant, "status").stdout
    assert "4 unanswered alarm(s) of the monitor" in told
    assert "judged by parts with 4 unanswered alarm(s)" in told
    answer = approved(plant)
    assert answer.exit_code == 0, answer.output
    assert "warning: alarms that nobody has answered cover part" in answer.stderr


def test_the_share_is_that_of_the_rows_inside_alarms(plant):
    assert alarmed_shares(plant, MACHINE, [odd_part(plant)]) == {}
    raise_alarms(plant, 0.5)
    np.testing.assert_allclose(alarmed_shares(plant, MACHINE, [odd_part(plant)])[odd_part(plant)], 0.5, atol=0.01)


def test_the_gate_itself_does_not_pass_on_a_part_full_of_alarms_and_doubts_errors_that_no_part_had(plant):
    # the one part that neither side had learnt from
    version = newest(plant)
    first = Ledger(plant.ledger).versions(MACHINE)[1]
    Ledger(plant.ledger).judged(MACHINE, first.version, {**first.gate, "passed": True})
    approve(plant, MACHINE, first.version, by="A. Ito", reason="two good parts")
    gate = judge_again(plant, version)
    assert gate["parts"] == [odd_part(plant)]
    assert gate["doubts"], "fifteen times the current, and errors to match"
    assert "look at the part" in gate["words"]
    raise_alarms(plant, 0.8)
    gate = judge_again(plant, version)
    assert not gate["passed"]
    assert "open alarms cover 80%" in gate["words"]
    assert gate["doubts"][0] in doubts(plant, replace(version, gate=gate))
    summary = {"metrics": {}, "gate": gate}
    assert gate["doubts"][0] in on_the_page(summary)
    assert gate["alarms"][0] in on_the_page(summary)
