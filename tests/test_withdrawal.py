"""A part that is withdrawn: as if it had not come, and nothing of it is lost."""

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner, Result
from plain_parts import parts as made_up

from pido import parts, plain, production, withdrawal
from pido.cli import pido
from pido.comparison import judge_again
from pido.core.errors import RegistryError, StoreError
from pido.monitoring.alarms import Alarm
from pido.monitoring.records import followed_as
from pido.recordings.folder import write_folder
from pido.store import Store
from pido.supervision.book import Book, alarm_id
from pido.supervision.part import Expectation
from pido.supervision.residuals import held_out, known_residuals
from pido.tracking import audit, promotion
from pido.tracking.ledger import Ledger
from pido.tracking.withdrawn import parts as that_count
from pido.workspace import Workspace

MACHINE = "cmx600v"
SETTINGS = "compare = false\n[method]\nadaptive = false\ncompare_with_model = false\n"
MADE = [part.rows(slice(0, 700)) for part in made_up(6)]
WHO = {"by": "A. Ito", "reason": "exported in mA"}


@pytest.fixture(autouse=True)
def without_mlflow(monkeypatch):
    monkeypatch.setattr(production, "log", lambda root: {"logged": 0, "fault": ""})


def spoilt(number: int):
    """As the part with this index, with currents that are wrong, but not by so much that it is refused."""
    one = MADE[number]
    return one.with_columns(**{name: 15.0 * one[name] for name in one.columns if name.startswith("curr_")})


def bring(workspace: Workspace, folder: Path) -> dict:
    return plain.run(workspace, [folder], None, lambda done, total, what: None)


@pytest.fixture(scope="module")
def made(tmp_path_factory) -> Path:
    """A workspace with two good parts, and a third part that is wrong."""
    root = tmp_path_factory.mktemp("made")
    (root / "ws").mkdir()
    (root / "ws" / "workspace.toml").write_text(SETTINGS.replace("", ""))
    workspace = Workspace.open(root / "ws")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(production, "log", lambda root: {"logged": 0, "fault": ""})
        for number, recording in enumerate((MADE[0], MADE[1], spoilt(2))):
            assert not bring(workspace, write_folder(recording, root / f"p{number}"))["rejected"]
    return root


@pytest.fixture
def plant(made, tmp_path) -> Workspace:
    shutil.copytree(made, tmp_path / "made")
    return Workspace.open(tmp_path / "made" / "ws")


def call(workspace: Workspace, verb: str, *words: str, status: int = 0) -> Result:
    answer = CliRunner().invoke(pido, [verb, *words, "-w", str(workspace.root)])
    assert answer.exit_code == status, (answer.output, answer.exception)
    return answer


def withdraw(workspace: Workspace, part: str = "demo-03", *more: str) -> str:
    return call(workspace, "withdraw", part, "--by", "A. Ito", "--reason", "exported in mA", *more).stdout


def digest_of(workspace: Workspace, name: str) -> str:
    return next(e.digest for e in Store(workspace.store).entries(MACHINE) if e.part == name)


def test_a_withdrawn_part_is_not_learnt_from_and_the_versions_that_had_are_not_approved(plant):
    before = {p: p.read_bytes() for p in plant.store.rglob("*.parquet")}
    said = withdraw(plant)
    assert "version 2 was trained on just the parts that count now" in said
    assert {p: p.read_bytes() for p in plant.store.rglob("*.parquet")} == before, "nothing is deleted"
    (challenger,) = [s.version.version for s in promotion.standings(plant, MACHINE) if s.state == "challenger"]
    assert challenger == 2
    with pytest.raises(RegistryError, match="demo-03"):
        promotion.check_version(plant, replace(Ledger(plant.ledger).versions(MACHINE)[2], gate={"passed": True}))
    assert judge_again(plant, Ledger(plant.ledger).versions(MACHINE)[2]).get("parts") == [digest_of(plant, "demo-02")]
    bring(plant, write_folder(MADE[3], plant.root.parent / "p4"))
    newest = Ledger(plant.ledger).versions(MACHINE)[-1]
    assert promotion.trained_on_withdrawn(plant, MACHINE).keys() == {3}
    assert newest.gate["parts"] == [digest_of(plant, name) for name in ("demo-02", "demo-04")]


def test_the_next_iterate_retrains_without_it_and_says_so(plant):
    bring(plant, write_folder(MADE[3], plant.root.parent / "p4"))
    assert "the next `pido iterate` retrains without it" in withdraw(plant)
    assert "trained without what is withdrawn: demo-03" in call(plant, "iterate").stdout
    assert "nothing to do" in call(plant, "iterate").stdout


def test_the_decision_is_in_the_chain_of_decisions_and_status_tells_it(plant):
    withdraw(plant)
    (record,) = promotion.history(plant, MACHINE)
    assert (record.action, record.name, record.by, record.reason) == ("withdraw", "demo-03", "A. Ito", "exported in mA")
    promotion.reject(plant, MACHINE, 1, by="B. Sato", reason="one part only")
    assert [r.action for r in audit.read(plant.decisions(MACHINE))] == ["withdraw", "reject"]
    told = call(plant, "status", "--history").stdout
    assert f"{MACHINE}: 2 part(s)" in told
    assert "withdrawn  demo-03" in told
    assert "withdraw demo-03 by A. Ito: exported in mA" in told
    log = plant.decisions(MACHINE)
    log.write_text(log.read_text().replace("exported in mA", "no reason at all"))
    with pytest.raises(RegistryError, match="changed outside the tool"):
        promotion.history(plant, MACHINE)


def test_another_recording_of_the_same_name_may_be_taken_in_and_the_withdrawn_one_not_again(plant):
    right = write_folder(MADE[2], plant.root.parent / "right")
    assert "pido withdraw" in bring(plant, right)["rejected"][0]["reason"]
    withdraw(plant)
    (again,) = bring(plant, plant.root.parent / "p2")["rejected"]
    assert "withdrawn" in again["reason"]
    assert "--undo" in call(plant, "iterate", str(plant.root.parent / "p2"), status=1).stderr
    assert "--undo" in call_ingest(plant, plant.root.parent / "p2")
    assert not bring(plant, right)["rejected"]
    assert [e.part for e in Store(plant.store).entries(MACHINE)] == ["demo-01", "demo-02", "demo-03"]
    assert len(that_count(plant, MACHINE)) == 3


def call_ingest(workspace: Workspace, folder: Path) -> str:
    answer = CliRunner().invoke(pido, ["ingest", str(folder), "--store", str(workspace.store), "--keep"])
    assert answer.exit_code == 1
    return answer.stderr


def test_it_is_no_longer_in_the_band_nor_is_what_models_said_that_had_learnt_from_it(plant):
    for number in (3, 4, 5):  # more parts than are predicted anew each time
        bring(plant, write_folder(MADE[number], plant.root.parent / f"p{number}"))
    gone = digest_of(plant, "demo-03")
    withdraw(plant)
    call(plant, "iterate")
    expect = Expectation.of(plant, MACHINE)
    assert gone not in expect.bundle.content["parts"]
    known = known_residuals(plant, MACHINE, expect.bundle, expect.models)
    assert gone not in {one.part for one in known}
    assert {digest_of(plant, name) for name in ("demo-04", "demo-05", "demo-06")} <= {one.part for one in known}
    largest = max(float(np.nanmax(np.abs(one.residual[:, 3]))) for one in known)
    assert largest < 10.0, "the spindle's errors are those of good models"
    earlier = held_out(plant, MACHINE, digest_of(plant, "demo-04"), expect.models.inputs)
    assert earlier is not None
    assert np.nanmax(np.abs(earlier.residual[:, 3])) < 10.0


def raise_alarm(workspace: Workspace, digest: str, part: str) -> str:
    book, alarm = Book(workspace, MACHINE), Alarm(digest, "x", 1.0, 2.0, "", 3, 1.0, 9.0)
    name = alarm_id(MACHINE, digest, alarm)
    said = {"id": name, "part": part, "axis": "x", "t_start": 1.0, "t_end": 2.0, "tool": "", "block": 3,
            "size_a": 1.0, "spreads": 9.0, "looks_like": "unknown"}  # fmt: skip
    book.verdict({"part": part, "digest": digest, "good": False, "alarms": [said]})
    return name


@pytest.mark.parametrize("followed", [False, True])
def test_its_alarms_are_closed_also_those_of_when_it_was_followed_and_open_again_when_it_is_back(plant, followed):
    digest = digest_of(plant, "demo-03")
    name = raise_alarm(plant, followed_as("demo-03", "abc") if followed else digest, "demo-03")
    book = Book(plant, MACHINE)
    assert [a.part for a in book.open_alarms()] == [digest]
    withdraw(plant)
    assert book.open_alarms() == []
    assert "withdrawn" in book.answered()[name]
    withdraw(plant, digest, "--undo")
    assert [a.part for a in book.open_alarms()] == [digest]
    assert name not in book.answered()
    withdraw(plant)
    bring(plant, write_folder(MADE[2], plant.root.parent / "right"))
    assert book.open_alarms() == [], "they are none of its successor's"


def test_undo_brings_it_back_as_it_was(plant):
    parts_before, challenger = that_count(plant, MACHINE), promotion.current(plant, MACHINE)
    withdraw(plant)
    assert "brought back" in withdraw(plant, "demo-03", "--undo")
    assert that_count(plant, MACHINE) == parts_before
    assert promotion.current(plant, MACHINE) == challenger
    assert [r.action for r in promotion.history(plant, MACHINE)] == ["withdraw", "reinstate"]
    assert digest_of(plant, "demo-03") == parts_before[2]


def test_a_part_whose_name_another_one_has_by_now_does_not_come_back(plant):
    gone = digest_of(plant, "demo-03")
    withdraw(plant)
    bring(plant, write_folder(MADE[2], plant.root.parent / "right"))
    with pytest.raises(StoreError, match="another recording has its name"):
        withdrawal.reinstate(plant, gone, **WHO)
    assert gone not in that_count(plant, MACHINE)


def test_withdrawing_twice_changes_nothing_and_says_who_did_it(plant):
    withdraw(plant)
    log = plant.decisions(MACHINE).read_bytes()
    again = call(plant, "withdraw", "demo-03", "--by", "C. Mori", "--reason", "me too").stdout
    assert "withdrawn already, and nothing was changed, by A. Ito" in again
    assert plant.decisions(MACHINE).read_bytes() == log


def test_a_part_that_is_not_there_not_out_or_without_a_reason_is_an_error_in_words(plant):
    with pytest.raises(StoreError, match=r"no part 'demo-9' here\. Known: demo-01, demo-02, demo-03"):
        withdrawal.withdraw(plant, "demo-9", **WHO)
    with pytest.raises(StoreError, match=r"'demo-03' .* is not withdrawn"):
        withdrawal.reinstate(plant, "demo-03", **WHO)
    with pytest.raises(RegistryError, match="--reason"):
        withdrawal.withdraw(plant, "demo-03", by="A. Ito", reason=" ")
    assert promotion.history(plant, MACHINE) == []


def test_a_withdrawal_that_died_before_the_store_followed_is_carried_out_by_the_next_iteration(plant, monkeypatch):
    with monkeypatch.context() as patch:
        patch.setattr(Store, "withdraw", lambda self, digest: (_ for _ in ()).throw(KeyboardInterrupt()))
        with pytest.raises(KeyboardInterrupt):
            withdrawal.withdraw(plant, "demo-03", **WHO)
    assert len(that_count(plant, MACHINE)) == 2, "the log decides"
    call(plant, "iterate")
    assert [e.part for e in Store(plant.store).entries(MACHINE)] == ["demo-01", "demo-02"]


def test_a_machine_all_of_whose_parts_are_withdrawn_says_so(plant):
    for part in ("demo-01", "demo-02", "demo-03"):
        said = withdraw(plant, part)
    assert "no part is left" in said
    with pytest.raises(StoreError, match="only parts that are withdrawn"):
        production.begin(str(plant.root), MACHINE, None)


def test_a_part_that_is_withdrawn_before_its_iteration_begins_is_not_learnt_from(plant):
    """Another process was first: `ingest` had let it in."""
    arrived = parts.ingest(str(plant.root), str(write_folder(MADE[3], plant.root.parent / "p4")))
    withdraw(plant, "demo-04")
    key = production.begin(str(plant.root), MACHINE, arrived["part"])
    assert key == plant.run_key(MACHINE, that_count(plant, MACHINE))
