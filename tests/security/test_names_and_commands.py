"""Names that strangers choose stay names: no path, no command, no markup; and nothing in the code runs text."""

from __future__ import annotations

import ast
from dataclasses import replace
from pathlib import Path
from urllib.parse import unquote

import pytest
from hypothesis import given
from hypothesis import strategies as st
from plain_parts import parts as made_up

from pido.core.names import file_name
from pido.departures import put_away
from pido.parts import ingest
from pido.recordings.folder import write_folder
from pido.store import Store
from pido.supervision.book import Book
from pido.workspace import Workspace

CODE = sorted(p for folder in ("pido", "flows", "deploy") for p in (Path(__file__).parents[2] / folder).rglob("*.py"))
HOSTILE = ("../../climbed", "/tmp/climbed", "$(touch climbed)", "; touch climbed", "`touch climbed`", "a|b # c", "..")


@given(st.text(min_size=1, max_size=60))
def test_every_name_is_one_path_component_and_comes_back(name):
    made = file_name(name)
    assert "/" not in made
    assert "\0" not in made
    assert made not in (".", "..")
    assert unquote(made) == name


@pytest.mark.parametrize("name", HOSTILE)
def test_a_part_and_a_machine_with_hostile_names_leave_nothing_outside_the_workspace(tmp_path, name, monkeypatch):
    monkeypatch.chdir(tmp_path)
    recording = next(made_up(1)).rows(slice(0, 120))
    named = replace(recording, part=recording.part.model_copy(update={"part": name}))
    arrived = write_folder(named, tmp_path / "in" / "p")
    workspace = Workspace.open(tmp_path / "deep" / "plant")
    taken = ingest(str(workspace.root), str(arrived))
    assert put_away(workspace, arrived, taken["key"]) is not None
    assert Store(workspace.store).load(taken["part"]).part.part == name
    with workspace.lock(name):
        Book(workspace, name).verdict({"part": name, "digest": "d", "machine": name, "good": True, "alarms": []})
    outside = [p for p in tmp_path.rglob("*") if p.is_file() and workspace.root not in p.parents]
    assert outside == []
    assert not Path("/tmp/climbed").exists()


def test_no_code_hands_text_to_a_shell_or_runs_it_and_no_pickle_is_read():
    forbidden = {"eval", "exec", "os.system", "os.popen", "pickle.load", "pickle.loads", "joblib.load", "__import__"}
    found = []
    for path in CODE:
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if not isinstance(node, ast.Call):
                continue
            asked = {k.arg: ast.unparse(k.value) for k in node.keywords}
            shell = asked.get("shell", "False") != "False"
            pickle = asked.get("allow_pickle", "False") != "False"
            loads_arrays = ast.unparse(node.func) in ("np.load", "numpy.load") and "allow_pickle" not in asked
            if ast.unparse(node.func) in forbidden or shell or pickle or loads_arrays:
                found.append(f"{path.name}:{node.lineno}: {ast.unparse(node)[:60]}")
    assert found == []
    assert len(CODE) > 100
