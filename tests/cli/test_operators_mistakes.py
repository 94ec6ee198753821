"""What an operator mistypes, verb by verb: where, what, and what to do, exit code 1, nothing made."""

from __future__ import annotations

from pathlib import Path

import pytest

from pido.tracking import bundle
from pido.tracking.ledger import Ledger
from pido.workspace import Workspace

WHO = ["--by", "A. Ito", "--reason", "a test"]


@pytest.fixture
def refused(call):
    """What a verb says on stderr where it cannot be done."""

    def run(*words: str | Path) -> str:
        code, _, said = call(*words)
        assert code == 1, said
        assert "Traceback" not in said
        return said

    return run


@pytest.fixture(scope="module")
def two(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A workspace with a version of each of two machines."""
    workspace = Workspace.open(tmp_path_factory.mktemp("plant"))
    for number, machine in enumerate(("mill 1", "mill 2")):
        made = bundle.save(workspace.bundles, {"machine": machine, "parts": [f"d{number}"]}, {"x.skops": b"x"})
        Ledger(workspace.ledger).finished(
            f"r{number}", machine, f"d{number}", "part 1", made.digest, {"passed": True}, {}
        )
    return workspace.root


@pytest.mark.parametrize("verb", [["approve", "1"], ["reject", "1"], ["rollback"]])
def test_where_several_machines_are_a_decision_asks_which_and_names_them(refused, two, verb):
    said = refused(*verb, *WHO, "-w", two)
    assert f"{two}: several machines here. Name one with --machine. Known: mill 1, mill 2." in said
    said = refused(*verb, *WHO, "-w", two, "--machine", "mill 3")
    assert f"{two}: no machine 'mill 3' here. Name one with --machine. Known: mill 1, mill 2." in said


@pytest.mark.parametrize("verb", [["approve", "7"], ["reject", "7"]])
def test_a_version_that_is_not_there_is_said_with_those_that_are(refused, two, verb):
    said = refused(*verb, *WHO, "-w", two, "--machine", "mill 1")
    assert "mill 1 has no version 7. Versions: 1." in said


@pytest.mark.parametrize(
    "verb",
    [
        ["approve", "1", *WHO], ["reject", "1", *WHO], ["rollback", *WHO], ["withdraw", "p1", *WHO], ["status"],
        ["monitor", __file__], ["iterate"], ["report", "iteration"],
    ],
    ids=lambda words: words[0],
)  # fmt: skip
def test_a_workspace_that_is_not_there_is_not_made_and_the_way_to_one_is_said(refused, tmp_path, verb):
    place = tmp_path / "plnat"
    more = ["--out", tmp_path / "page.html"] if verb[0] == "report" else []
    said = refused(*verb, *more, "-w", place)
    assert f"{place}: no workspace here" in said
    assert "--workspace" in said
    assert not place.exists()


def test_parts_that_are_not_there_make_no_workspace(refused, tmp_path):
    said = refused("iterate", tmp_path / "p01", tmp_path / "p02", "-w", tmp_path / "plant")
    assert said.count("no such file or folder. Name a part that is there.") == 2
    assert not (tmp_path / "plant").exists()


def test_a_rejected_part_is_named_once_in_its_line(refused, tmp_path):
    (tmp_path / "p01.parquet").write_bytes(b"no Parquet")
    said = refused("iterate", tmp_path / "p01.parquet", "-w", tmp_path / "plant")
    assert f"rejected {tmp_path / 'p01.parquet'}: damaged or cut off" in said


def test_a_workspace_without_parts_says_that_it_has_none(call, tmp_path):
    (tmp_path / "workspace.toml").write_text("seed = 3\n")
    code, said, _ = call("iterate", "-w", tmp_path)
    assert code == 0
    assert said == "no part was taken in yet: bring one with `pido iterate PART`\n"


def test_settings_that_are_no_text_are_refused_with_what_to_do(refused, tmp_path):
    (tmp_path / "workspace.toml").write_bytes(b"\xff\xfe")
    (tmp_path / "ledger.db").touch()
    said = refused("status", "-w", tmp_path)
    assert f"{tmp_path / 'workspace.toml'}: not a TOML file" in said
    assert "Correct it, or name another." in said


def test_a_part_that_is_not_there_is_said_with_those_that_are(refused, two):
    said = refused("withdraw", "p9", *WHO, "-w", two)
    assert "no part 'p9' here" in said
