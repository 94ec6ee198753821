"""The same samples under another part.json: said, never silently taken; and the way to correct what is stored."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from click.testing import CliRunner, Result
from plain_parts import parts as made_up

from pido.cli import pido
from pido.core.errors import StoreError
from pido.core.part import PartInfo
from pido.core.recording import Recording
from pido.recordings.folder import write_folder
from pido.store import Store

MACHINE = "cmx600v"
MADE = next(made_up(1)).rows(slice(0, 300))


def told(**says: object) -> Recording:
    """The part with a part.json that says these things, too."""
    return Recording(PartInfo(**{"part": "p01", "machine": MACHINE, "order": 1, **says}), MADE.columns)  # type: ignore[arg-type]


STEEL, ALUMINIUM = told(material="C45"), told(material="AlMgSi1", tools={"3": {"diameter_mm": 8.0}})


def ingest(recording: Recording, place: Path, *words: str) -> Result:
    folder = write_folder(recording, place / f"{recording.part.part} {recording.part.material}")
    return CliRunner().invoke(pido, ["ingest", str(folder), "--store", str(place / "store"), "--keep", *words])


def test_which_part_it_is_what_its_part_json_says_otherwise_and_what_to_do_is_said(tmp_path, caplog):
    first = ingest(STEEL, tmp_path)
    assert first.stdout.startswith("stored")
    again = ingest(ALUMINIUM, tmp_path)
    digest = first.stdout.split()[1]
    assert again.stdout.split()[:3] == ["known", digest, "p01"]
    assert 'material (stored: "C45", here: "AlMgSi1")' in caplog.text
    assert 'tools (stored: nothing, here: {"3":{"diameter_mm":8.0}})' in caplog.text
    assert f"What is stored stays; if it is wrong, `pido withdraw {digest}`, then bring this one again" in caplog.text
    assert Store(tmp_path / "store").load(Store(tmp_path / "store").entries()[0].digest).part.material == "C45"


def test_a_machine_reads_it_in_the_notes(tmp_path):
    ingest(STEEL, tmp_path)
    [note] = json.loads(ingest(ALUMINIUM, tmp_path, "--json").stdout)["notes"]
    assert 'here: "AlMgSi1"' in note


def test_another_name_alone_is_said_and_nothing_has_to_be_done(tmp_path):
    store = Store(tmp_path)
    store.add(STEEL)
    assert store.add(told(part="p02", material="C45")).told == (
        'Its part.json says otherwise: part (stored: "p01", here: "p02"). What is stored stays'
    )
    assert store.add(STEEL).told == ""


def test_a_withdrawn_part_comes_again_under_a_corrected_description_and_under_no_other(tmp_path):
    store = Store(tmp_path)
    wrong = store.add(STEEL)
    store.withdraw(wrong.digest)
    with pytest.raises(StoreError, match="was withdrawn"):
        store.add(told(part="p02", order=7, material="C45"))
    right = store.add(ALUMINIUM)
    assert right.new
    assert [(e.digest, e.part) for e in store.entries()] == [(right.digest, "p01")]
    assert store.load(right.digest).part.material == "AlMgSi1"
    assert store.add(told(part="p03", material="AlMgSi1")).digest == right.digest, "the one that counts, not the other"
    store.withdraw(right.digest)
    store.reinstate(wrong.digest)
    assert [e.digest for e in store.entries()] == [wrong.digest]


def test_of_two_descriptions_of_the_same_samples_one_counts(tmp_path):
    store = Store(tmp_path)
    wrong = store.add(STEEL)
    store.withdraw(wrong.digest)
    store.add(told(part="p09", material="AlMgSi1"))
    with pytest.raises(StoreError, match="part 'p09' has its samples, with another description"):
        store.reinstate(wrong.digest)
    assert [e.part for e in store.entries()] == ["p09"]
