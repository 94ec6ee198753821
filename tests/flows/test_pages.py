"""What stands on Prefect's pages, read as a viewer of Markdown reads it; calls that are printed are run."""

from __future__ import annotations

import re
import shlex

import pytest
from click.testing import CliRunner
from markdown_it import MarkdownIt
from written_diagnosis import diagnosis

from flows.diagnose import line
from flows.diagnose import page as diagnosis_page
from flows.new_part import nothing_new, page
from flows.pages import in_markdown, key
from flows.promote import Decision, Rejection, form, promote
from pido.accepted import acceptable
from pido.approval import approve, refusal
from pido.cli import pido
from pido.core.errors import RegistryError
from pido.diagnosis.finding import Evidence, Finding, HeldOut, Where
from pido.physics_journal import in_force, journal
from pido.tracking import bundle, promotion
from pido.tracking.ledger import Ledger
from pido.workspace import Workspace

MACHINE = "dmc60h"
ODD = r"below |v_y| = 1.3 mm/s, part a\|b<c *it* _u_ `x` [l](m) &#124; &amp; ~s~ **b**"


@pytest.fixture
def plant(tmp_path) -> Workspace:
    """Two versions of a machine: the first did not pass its gate, the second did."""
    place = Workspace.open(tmp_path / "a plant")
    for number, passed in ((1, False), (2, True)):
        models = {f"{axis}.skops": f"{axis}{number}".encode() for axis in ("x", "y", "z", "sp")}
        made = bundle.save(place.bundles, {"machine": MACHINE, "parts": [f"p{number}"]}, models)
        gate, about = {"passed": passed, "words": f"x: {ODD}"}, {"gate": {}, "metrics": {}}
        Ledger(place.ledger).finished(f"run{number}", MACHINE, f"p{number}", f"p{number}", made.digest, gate, about)
    return place


def shown(markdown: str) -> list[str]:
    """The text of each heading, paragraph and cell, in order, without what marks it up."""
    tokens = MarkdownIt().enable("table").parse(markdown)
    inline = [t.children or [] for t in tokens if t.type == "inline"]
    return ["".join(c.content for c in children) for children in inline]


def calls(markdown: str) -> list[list[str]]:
    """The calls that stand on a page as blocks, as a shell reads them."""
    return [shlex.split(t.content) for t in MarkdownIt().parse(markdown) if t.type == "fence"]


def run(call: list[str]) -> str:
    assert call[0] == "pido"
    done = CliRunner().invoke(pido, call[1:], catch_exceptions=False)
    assert done.exit_code == 0, done.output
    return done.output


def test_text_from_outside_is_shown_as_it_is_in_a_heading_and_in_a_cell():
    text = in_markdown(ODD)
    assert shown(f"# {text}\n\n{text}\n\n| a |\n|---|\n| {text} |") == [ODD, ODD, "a", ODD]
    assert "&#124;" not in in_markdown("|"), "Prefect's pages show entities letter for letter"


@pytest.mark.parametrize("mechanism", ["stribeck_friction", "input_fault"])
def test_a_finding_is_a_row_of_the_table_whatever_its_words_hold(plant, mechanism):
    fit = HeldOut("leave-one-part-out", 0.31, 0.12, 0.6, 0.9, 1e-5)
    found = Finding("y", mechanism, "missing_physics", "", {}, Where(ODD), Evidence(0.0, 0.0, 0.0), fit)
    text = diagnosis_page(plant, "m", {"parts": ["p"], "compared": True, "lines": [line(found)], "notes": [ODD]}, [])
    errors = ["–", "–"] if mechanism == "input_fault" else ["0.31", "0.12"]
    head = ["axis", "mechanism", "where", "RMSE before, A", "after, A"]
    assert shown(text)[2:-1] == [*head, "y", mechanism, ODD, *errors, ODD]


def test_artifacts_of_two_machines_have_two_keys_that_prefect_takes():
    keys = [key("iteration", machine) for machine in ("m1", "M1", "mill 1/hall ü", "mill 1/hall ö", "ü", "mill-1")]
    assert len(set(keys)) == len(keys)
    assert all(re.fullmatch("iteration-[a-z0-9]+(-[a-z0-9]+)*", k) for k in keys)


def test_the_call_that_accepts_a_finding_works_as_it_stands_there_and_only_once(plant):
    folder = diagnosis(plant.diagnosis(MACHINE), machine=MACHINE)
    found = {"parts": ["p"], "compared": True, "lines": ["| x | stribeck |"], "notes": []}
    [call] = calls(diagnosis_page(plant, MACHINE, found, acceptable(plant, MACHINE, folder)))
    assert "stribeck_friction" in run(call)
    assert [e.mechanism for e in in_force(journal(plant, MACHINE))] == ["stribeck_friction"]
    assert calls(diagnosis_page(plant, MACHINE, found, acceptable(plant, MACHINE, folder))) == []


@pytest.mark.parametrize(
    ("mechanism", "kind"), [("position_dependent_friction", "missing_physics"), ("stribeck_friction", "data_fault")]
)
def test_no_call_is_shown_for_what_cannot_extend_the_equation(plant, mechanism, kind):
    folder = diagnosis(plant.diagnosis(MACHINE), mechanism, kind, machine=MACHINE)
    assert acceptable(plant, MACHINE, folder) == []


def outcome(version: int, plant: Workspace) -> dict:
    gate = Ledger(plant.ledger).versions(MACHINE)[version - 1].gate
    part = {"name": "p*2*"}
    return {
        "machine": MACHINE,
        "version": version,
        "part": part,
        "gate": gate,
        "run_key": f"run{version}",
        "metrics": {},
    }


def test_the_page_of_a_version_names_machine_and_part_and_its_call_puts_the_version_in_force(plant):
    text = page(plant, outcome(2, plant), "MLflow is away")
    assert shown(text)[:2] == [f"{MACHINE}, part p*2*: version 2", f"x: {ODD}"]
    assert "Not in MLflow yet (MLflow is away)" in text
    [call] = calls(text)
    run([*call, "--no-mirror"])
    now = promotion.champion(plant, MACHINE)
    assert now is not None
    assert (now.version, now.by, now.reason) == (2, "NAME", "TEXT")
    assert calls(page(plant, outcome(2, plant), "")) == [], "it is in force"


def test_a_version_that_did_not_pass_its_gate_has_no_call(plant):
    assert calls(page(plant, outcome(1, plant), "")) == []


def test_a_known_part_is_named_and_no_other():
    assert nothing_new("m", "p01", 3).startswith(
        "Nothing new: this is part p01 of m, which is known already; version 3 "
    )
    assert nothing_new("m", "", 3).startswith("Nothing new: version 3 is the one of today's parts")


def test_the_form_says_what_the_gate_said_and_that_a_rejection_is_final(plant):
    failed, passed = (form(v, refusal(plant, v)) for v in Ledger(plant.ledger).versions(MACHINE))
    assert shown(failed)[1].startswith(f"Approval is not offered: {MACHINE} version 1 did not pass its gate")
    assert shown(passed)[1:3] == [f"Gate passed: x: {ODD}.", "Approve puts it in force."]
    for said in (failed, passed):
        assert "Reject is final" in said
        assert f"x: {ODD}." in shown(said)[1]


def test_the_form_offers_what_would_be_done_and_nothing_that_would_be_refused(plant):
    _, offered = Ledger(plant.ledger).versions(MACHINE)
    assert refusal(plant, offered) == ""
    with pytest.raises(RegistryError, match="did not pass its gate"):
        approve(plant, MACHINE, 1, by="A. Ito", reason="I insist")
    schemas = [asked.model_json_schema()["properties"]["decision"]["enum"] for asked in (Decision, Rejection)]
    assert schemas == [["approve", "reject"], ["reject"]]
    given = {"decision": "approve", "by": "A. Ito", "reason": "good"}  # on a form of the time when it was offered
    assert Rejection(**given).decision == "approve"
    next(plant.bundles.glob(f"{offered.bundle}/x.skops")).write_bytes(b"damaged")
    assert "x.skops" in refusal(plant, offered)
    promotion.reject(plant, MACHINE, 2, by="A. Ito", reason="damaged")
    assert "was rejected" in refusal(plant, offered)


def test_nobody_is_asked_for_a_decision_where_the_worker_lacks_the_credential(plant, monkeypatch):
    monkeypatch.delenv(promotion.TOKEN, raising=False)
    (plant.root / "workspace.toml").write_text(f'approval_token_sha256 = "{64 * "0"}"\n')
    with pytest.raises(RegistryError, match="asks for a credential"):
        promote.fn(str(plant.root), MACHINE, 2)
