"""Approval, rejection, rollback: one step, none lost, none waived, all on record."""

from __future__ import annotations

import dataclasses
import hashlib
import itertools
import json
import resource
import subprocess
import sys

import pytest

from pido.core.errors import RegistryError
from pido.physics_journal import Entry, journal, write
from pido.physics_journal import in_force as now_in_force
from pido.tracking import audit, bundle, promotion
from pido.tracking.ledger import Ledger
from pido.workspace import Workspace

MACHINE = "m1"


def add_version(workspace: Workspace, number: int, passed: bool = True, **more: object) -> str:
    models = {f"model_{axis}.skops": f"{axis}{number}".encode() for axis in ("x", "y", "z", "sp")}
    made = bundle.save(workspace.bundles, {"machine": MACHINE, "parts": [f"p{number}"]}, models)
    gate = {"passed": passed, "words": "x is worse by 3 %" if not passed else "no axis is worse", **more}
    Ledger(workspace.ledger).finished(f"run{number}", MACHINE, f"p{number}", f"part {number}", made.digest, gate, {})
    return made.digest


@pytest.fixture
def workspace(tmp_path) -> Workspace:
    workspace = Workspace.open(tmp_path / "plant")
    for number in (1, 2, 3):
        add_version(workspace, number)
    add_version(workspace, 4, passed=False)
    return workspace


def trained_with(workspace: Workspace, number: int, physics: list[str]) -> None:
    """A version of the workspace's present settings."""
    made = bundle.save(workspace.bundles, {"machine": MACHINE, "number": number}, {})
    key = workspace.run_key(MACHINE, ["p"])
    passed, summary = {"passed": True}, {"physics": {"accepted": physics}}
    Ledger(workspace.ledger).finished(key, MACHINE, "p", "p", made.digest, passed, summary)


def in_force(workspace: Workspace) -> int | None:
    record = promotion.champion(workspace, MACHINE)
    return None if record is None else record.version


def decide(action, workspace, *version, **who):
    return action(workspace, MACHINE, *version, **{"by": "A. Ito", "reason": "good parts", **who})


def test_nothing_is_in_force_until_a_person_approved_it(workspace):
    assert promotion.champion(workspace, MACHINE) is None


def test_approval_and_rollback_move_the_champion_and_back_through_all_that_were_before(workspace):
    for version in (1, 2, 3):
        decide(promotion.approve, workspace, version)
    assert [decide(promotion.rollback, workspace).version for _ in range(2)] == [2, 1]
    with pytest.raises(RegistryError, match="no champion before"):
        decide(promotion.rollback, workspace)
    assert in_force(workspace) == 1


def test_a_gate_that_was_not_passed_cannot_be_waived(workspace):
    with pytest.raises(RegistryError, match="x is worse by 3 %"):
        decide(promotion.approve, workspace, 4, reason="I insist")
    assert promotion.champion(workspace, MACHINE) is None


def test_a_version_that_was_compared_with_another_champion_does_not_replace_the_one_in_force_unseen(workspace):
    second = Ledger(workspace.ledger).versions(MACHINE)[1].bundle
    add_version(workspace, 5, champion=None)
    add_version(workspace, 6, champion=second)
    decide(promotion.approve, workspace, 1)
    with pytest.raises(
        RegistryError, match=r"5 passed its gate while nothing .* version 1 is in force.*`pido approve 5`"
    ):
        decide(promotion.approve, workspace, 5)
    with pytest.raises(RegistryError, match="beside version 2"):
        decide(promotion.approve, workspace, 6)
    assert in_force(workspace) == 1
    decide(promotion.approve, workspace, 2)
    assert decide(promotion.approve, workspace, 6).version == 6


def test_a_rejected_version_is_not_approved_any_more(workspace):
    decide(promotion.reject, workspace, 2)
    with pytest.raises(RegistryError, match="was rejected"):
        decide(promotion.approve, workspace, 2)


def test_a_rollback_passes_over_what_was_rejected_since_and_says_so_where_nothing_is_left(workspace):
    for version in (1, 2, 3):
        decide(promotion.approve, workspace, version)
    decide(promotion.reject, workspace, 2)
    assert decide(promotion.rollback, workspace).version == 1
    decide(promotion.approve, workspace, 3)
    assert decide(promotion.rollback, workspace).version == 1
    decide(promotion.approve, workspace, 3)
    decide(promotion.reject, workspace, 1)
    with pytest.raises(RegistryError, match=r"rejected since: version 1.*pido approve VERSION"):
        decide(promotion.rollback, workspace)
    assert in_force(workspace) == 3


def test_a_rollback_goes_back_to_another_version_than_the_one_in_force(workspace):
    for version in (3, 1, 2, 1):
        decide(promotion.approve, workspace, version)
    decide(promotion.reject, workspace, 2)
    assert decide(promotion.rollback, workspace).version == 3


def test_each_decision_says_who_when_and_why(workspace):
    decide(promotion.approve, workspace, 1, by="A. Ito", reason="three good parts")
    decide(promotion.reject, workspace, 2, by="B. Ruiz", reason="worn tool")
    log = promotion.history(workspace, MACHINE)
    assert [(r.action, r.version, r.by, r.reason) for r in log] == [
        ("approve", 1, "A. Ito", "three good parts"),
        ("reject", 2, "B. Ruiz", "worn tool"),
    ]


@pytest.mark.parametrize("who", [{"by": " "}, {"reason": ""}])
def test_a_decision_without_a_name_or_a_reason_is_refused(workspace, who):
    with pytest.raises(RegistryError, match="who made it and why"):
        decide(promotion.approve, workspace, 1, **who)


@pytest.mark.parametrize("change", ["edit", "remove", "swap", "remove the last"])
def test_an_audit_log_that_was_changed_by_hand_is_found_and_nothing_is_promoted_on_it(workspace, change):
    for version in (1, 2, 3):
        decide(promotion.approve, workspace, version)
    path = workspace.registry / MACHINE / "audit.jsonl"
    lines = path.read_text().splitlines(keepends=True)
    if change == "edit":
        lines[1] = lines[1].replace("A. Ito", "N. Obody")
    elif change.startswith("remove"):
        del lines[1 if change == "remove" else -1]
    else:
        lines[0], lines[1] = lines[1], lines[0]
    path.write_text("".join(lines))
    with pytest.raises(RegistryError, match="changed outside"):
        decide(promotion.rollback, workspace)
    assert in_force(workspace) == 3


def test_a_rejection_that_is_taken_out_of_the_log_does_not_come_back_as_an_approval(workspace):
    decide(promotion.approve, workspace, 1)
    decide(promotion.reject, workspace, 2)
    path = workspace.registry / MACHINE / "audit.jsonl"
    whole = path.read_text()
    for cut in ("".join(whole.splitlines(keepends=True)[:-1]), ""):
        path.write_text(cut)
        with pytest.raises(RegistryError, match=r"records were taken out.*audit.head.json"):
            decide(promotion.approve, workspace, 2)
    path.write_text(whole)
    with pytest.raises(RegistryError, match="was rejected"):
        decide(promotion.approve, workspace, 2)


def test_a_log_from_before_there_were_seals_and_one_whose_writer_died_before_its_seal_are_read_and_sealed(workspace):
    decide(promotion.approve, workspace, 1)
    head = workspace.registry / MACHINE / "audit.head.json"
    first = head.read_bytes()
    head.unlink()
    decide(promotion.approve, workspace, 2)
    assert json.loads(head.read_text())["lines"] == 2
    head.write_bytes(first)  # the process died between the log and its seal
    assert [r.version for r in promotion.history(workspace, MACHINE)] == [1, 2]
    decide(promotion.approve, workspace, 3)
    assert json.loads(head.read_text())["lines"] == 3


def written_by_a_later_release(path, **said):
    """A record of a kind that is not known here, chained and hashed as the format has it."""
    *_, last = [json.loads(line) for line in path.read_text().splitlines()]
    record = {"number": last["number"] + 1, "previous": last["hash"], "machine": MACHINE, "at": "2027-01-01", **said}
    record["hash"] = hashlib.sha256(json.dumps(record, sort_keys=True).encode()).hexdigest()
    with path.open("a") as log:
        log.write(json.dumps(record, sort_keys=True) + "\n")
    return record


def test_what_a_later_release_has_written_into_the_log_is_kept_shown_and_decides_nothing(workspace):
    decide(promotion.reject, workspace, 2)
    path = workspace.registry / MACHINE / "audit.jsonl"
    about = {"version": 2, "bundle": "", "by": "C. Wu", "reason": "tool"}
    freeze = written_by_a_later_release(path, action="freeze", until="2027-02-01", **about)
    written_by_a_later_release(path, action="handover")
    written_by_a_later_release(path, action="approve", version=1, bundle="b", by="D", reason="fine", station="7")
    lines = path.read_bytes()
    assert [r.action for r in promotion.history(workspace, MACHINE)] == ["reject", "freeze", "handover", "approve"]
    assert promotion.standings(workspace, MACHINE)[1].state == "rejected"
    decide(promotion.approve, workspace, 3)
    assert path.read_bytes().startswith(lines)
    records = audit.read(path)
    assert (records[1].more, records[1].hash, records[4].previous) == (
        {"until": "2027-02-01"}, freeze["hash"], records[3].hash
    )  # fmt: skip
    call = [sys.executable, "-m", "pido.cli", "status", "--history", "--workspace", str(workspace.root)]
    said = subprocess.run(call, capture_output=True, text=True, check=True).stdout
    assert "freeze (of a later release: it decides nothing here; version 2, until 2027-02-01) by C. Wu: tool" in said
    assert "handover (of a later release" in said
    path.write_bytes(path.read_bytes().replace(b"2027-02-01", b"2029-02-01"))
    with pytest.raises(RegistryError, match="record 2: its content does not match its hash"):
        audit.read(path)


def test_what_a_later_release_has_written_into_the_journal_of_physics_is_kept(tmp_path):
    place = Workspace.open(tmp_path / "plant")
    entry = Entry(1, "accept", "ab12", "x", "stribeck_friction", "A", "seen", "", {"a": 1}, "", "")
    write(place, MACHINE, [entry])
    digest = place.physics_digest(MACHINE)
    later = dataclasses.replace(entry, version=2, action="measured", more={"at_temperature_c": 21})
    write(place, MACHINE, [entry, later])
    assert json.loads(place.physics_journal(MACHINE).read_text().splitlines()[1])["at_temperature_c"] == 21
    assert journal(place, MACHINE) == [entry, later]
    assert now_in_force(journal(place, MACHINE)) == [entry]
    assert place.physics_digest(MACHINE) == digest


def test_a_bundle_whose_model_file_was_swapped_is_not_put_in_force(workspace):
    digest = Ledger(workspace.ledger).versions(MACHINE)[0].bundle
    (workspace.bundles / digest / "model_x.skops").write_bytes(b"something else")
    with pytest.raises(RegistryError, match="not the file that was registered"):
        decide(promotion.approve, workspace, 1)


def test_a_log_entry_cut_short_by_a_crash_is_no_entry(workspace):
    decide(promotion.approve, workspace, 1)
    path = workspace.registry / MACHINE / "audit.jsonl"
    with path.open("ab") as handle:
        handle.write(b'{"action": "appro')
    decide(promotion.approve, workspace, 2)
    assert [r.version for r in audit.read(path)] == [1, 2]


@pytest.mark.parametrize("where", ["before the rename", "after the rename"])
def test_a_promotion_that_dies_half_way_has_moved_all_or_nothing(workspace, where):
    decide(promotion.approve, workspace, 1)
    code = f"""
import os, signal
from pathlib import Path
from pido.tracking import audit, promotion
from pido.workspace import Workspace
rename, append = Path.replace, audit.append
def die(*a): os.kill(os.getpid(), signal.SIGKILL)
if {where!r} == "before the rename":
    Path.replace = die
else:
    audit.append = lambda path, record: record.version == 2 and die()
promotion.approve(Workspace.open({str(workspace.root)!r}), {MACHINE!r}, 2, by="A", reason="B")
"""
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == -9
    moved = where == "after the rename"
    assert in_force(workspace) == (2 if moved else 1)
    assert [r.version for r in promotion.history(workspace, MACHINE)] == ([1, 2] if moved else [1])
    decide(promotion.approve, workspace, 3)
    assert [r.version for r in audit.read(workspace.registry / MACHINE / "audit.jsonl")] == (
        [1, 2, 3] if moved else [1, 3]
    )


def test_where_a_credential_is_asked_for_a_decision_without_it_is_refused(tmp_path, monkeypatch):
    token = hashlib.sha256(b"open sesame").hexdigest()
    workspace = Workspace.open(tmp_path / "plant", approval_token_sha256=token)
    add_version(workspace, 1)
    with pytest.raises(RegistryError, match="credential"):
        decide(promotion.approve, workspace, 1)
    monkeypatch.setenv(promotion.TOKEN, "open sesame")
    assert decide(promotion.approve, workspace, 1).version == 1


def test_rollback_through_the_command_line_takes_less_than_a_second(workspace):
    for version in (1, 2):
        decide(promotion.approve, workspace, version)
    call = ["rollback", "--by", "A. Ito", "--reason", "alarms", "--workspace", str(workspace.root)]
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    done = subprocess.run([sys.executable, "-m", "pido.cli", *call], capture_output=True, text=True, check=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    assert "version 1 is champion" in done.stdout
    # processor time: what else runs on the machine is not this command's
    assert after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime < 1.0


def test_status_names_champion_challenger_and_rejected_versions(workspace):
    decide(promotion.approve, workspace, 1)
    decide(promotion.reject, workspace, 2)
    call = [sys.executable, "-m", "pido.cli", "status", "--json", "--workspace", str(workspace.root)]
    answer = json.loads(subprocess.run(call, capture_output=True, text=True, check=True).stdout)
    states = [v["state"] for v in answer["machines"][MACHINE]["versions"]]
    assert states == ["champion", "rejected", "superseded", "challenger"]


def test_the_challenger_is_the_version_of_the_settings_of_today_also_where_they_were_others_in_between(tmp_path):
    root = tmp_path / "plant"
    for number, seed in ((1, 0), (2, 5)):
        trained_with(Workspace.open(root, seed=seed), number, [])
    states = {s: [v.state for v in promotion.standings(Workspace.open(root, seed=s), MACHINE)] for s in (0, 5, 7)}
    newest = ["superseded", "challenger"]
    assert states == {0: newest[::-1], 5: newest, 7: newest}
    faulty = Workspace.open(root, jobs={MACHINE: "missing.toml"})
    assert [v.state for v in promotion.standings(faulty, MACHINE)] == newest


def test_a_rollback_passes_over_what_was_trained_with_physics_that_was_revoked_since(tmp_path):
    place = Workspace.open(tmp_path / "plant")
    entry = Entry(1, "accept", "ab12", "x", "stribeck_friction", "A", "seen", "", {}, "", "")
    write(place, MACHINE, [entry])
    for number, physics in ((1, []), (2, [entry.term_name]), (3, [])):
        trained_with(
            dataclasses.replace(place, settings=Workspace.open(place.root, seed=number).settings), number, physics
        )
        decide(promotion.approve, place, number)
    write(place, MACHINE, [entry, dataclasses.replace(entry, version=2, action="revoke")])
    with pytest.raises(RegistryError, match="trained with physics that is revoked: x stribeck_friction ab12"):
        decide(promotion.approve, place, 2)
    call = [sys.executable, "-m", "pido.cli", "status", "--workspace", str(place.root)]
    says = "was trained with physics that is revoked: x stribeck_friction ab12"
    assert says not in subprocess.run(call, capture_output=True, text=True, check=True).stdout
    assert decide(promotion.rollback, place).version == 1
    decide(promotion.approve, place, 3)
    write(place, MACHINE, [entry])
    assert decide(promotion.approve, place, 2).version == 2
    write(place, MACHINE, [entry, dataclasses.replace(entry, version=2, action="revoke")])
    assert says in subprocess.run(call, capture_output=True, text=True, check=True).stdout


def test_a_record_is_bound_to_its_content():
    record = audit.Record(1, "approve", "m", 1, "b", "A", "r", "2026-01-01", audit.GENESIS).sealed()
    assert dataclasses.replace(record, reason="other").sealed().hash != record.hash


def test_a_decision_does_not_wait_for_an_iteration_of_the_machine(workspace):
    with workspace.lock(MACHINE):
        assert decide(promotion.approve, workspace, 1).version == 1


def test_decisions_that_come_at_once_are_all_on_record_one_after_another(workspace):
    call = "import sys; from pido.workspace import Workspace; from pido.tracking import promotion\n"
    call += "place = Workspace.open(sys.argv[1])\n"
    call += f"for n in (1, 2, 3) * 5: promotion.approve(place, {MACHINE!r}, n, by=sys.argv[2], reason='at once')"
    people = [
        subprocess.Popen([sys.executable, "-c", call, str(workspace.root), name], stderr=subprocess.PIPE)
        for name in ("A. Ito", "B. Ruiz", "C. Okafor")
    ]
    faults = [person.communicate()[1] for person in people]
    assert [person.returncode for person in people] == [0, 0, 0], faults
    log = promotion.history(workspace, MACHINE)
    assert [r.number for r in log] == list(range(1, len(log) + 1))
    assert all(a.version != b.version for a, b in itertools.pairwise(log)), "the champion is not approved again"
    assert promotion.champion(workspace, MACHINE) == log[-1]
