"""A verdict is that of the version in force: what it expects, and limits from what it was wrong by."""

import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from click.testing import CliRunner

from pido.cli import pido
from pido.core.axes import AXES
from pido.core.recording import Recording
from pido.models.inputs import model_inputs
from pido.parts import samples_of
from pido.recordings import read_recording
from pido.recordings.folder import write_folder
from pido.supervision.book import Book
from pido.supervision.part import Expectation, monitor
from pido.supervision.residuals import known_residuals
from pido.supervision.stream import follow_file
from pido.tracking import promotion
from pido.tracking.ledger import Ledger
from pido.workspace import Workspace

SETTINGS = "compare = false\n[method]\nadaptive = false\ncompare_with_model = false\n"
ROWS = 900
MACHINE = "cmx600v"


@pytest.fixture(scope="module")
def plant(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A workspace with a version after each of four parts, and a fifth part beside it that was judged by the
    newest one before the second was put in force."""
    from pido.plain import run
    from pido.synthetic.families import impellers
    from pido.synthetic.machine import produce
    from pido.synthetic.mills import newer_vertical

    root = tmp_path_factory.mktemp("plant")
    mill = newer_vertical()
    folders = []
    for k, course in enumerate(mill.plan(impellers(mill.machine, 5))):
        whole = produce(mill, [course], seed=k, with_simulation=False)[0].recording
        some = whole.rows(slice(len(whole) // 3, len(whole) // 3 + ROWS))
        info = some.part.model_copy(update={"part": f"p{k}", "order": k + 1})
        folders.append(write_folder(Recording(info, some.columns), root / info.part))
    (root / "ws").mkdir()
    (root / "ws" / "workspace.toml").write_text(SETTINGS)
    workspace = Workspace.open(root / "ws")
    for folder in folders[:4]:
        run(workspace, [folder], None, lambda done, total, what: None)
    (root / "before.json").write_text(json.dumps(_verdict(root)))
    promotion.approve(workspace, MACHINE, 2, by="ann", reason="first")
    return root


def _verdict(plant: Path) -> dict[str, Any]:
    """Of the fifth part."""
    result = CliRunner().invoke(pido, ["monitor", str(plant / "p4"), "-w", str(plant / "ws"), "--json"])
    return json.loads(result.stdout)


def test_a_version_put_in_force_between_two_verdicts_brings_its_own_name_and_its_own_limits(plant):
    before, after = json.loads((plant / "before.json").read_text()), _verdict(plant)
    assert before["model"] == "challenger version 4"
    assert after["model"] == "champion version 2"
    assert before["band"]["threshold"] != after["band"]["threshold"]


def test_parts_that_a_version_has_not_learnt_from_are_judged_by_its_own_models(plant):
    workspace = Workspace.open(plant / "ws")
    expect = Expectation.of(workspace, MACHINE)
    known = known_residuals(workspace, MACHINE, expect.bundle, expect.models)
    assert [one.part for one in known] == list(Ledger(workspace.ledger).parts(MACHINE))
    for one in known[2:]:
        said = expect.models.predict_inputs(model_inputs(samples_of(workspace, one.part), expect.models.inputs))
        spindle = one.predicted[:, AXES.index("sp")]
        assert spindle[np.isfinite(spindle)] == pytest.approx(said[:, AXES.index("sp")])


@pytest.mark.parametrize(
    ("settings", "same_models"),
    [(SETTINGS + 'inputs = "paper"\n', True), ('compare = false\nmethod = "paper"\n', False)],
    ids=["other inputs", "another method"],
)
def test_a_version_still_judges_when_the_settings_ask_for_successors_with_other_inputs(
    plant, tmp_path, settings, same_models
):
    shutil.copytree(plant / "ws", tmp_path / "ws")
    shutil.copytree(plant / "p4", tmp_path / "p4")
    before = _verdict(tmp_path)
    (tmp_path / "ws" / "workspace.toml").write_text(settings)
    after = _verdict(tmp_path)
    assert after["model"] == before["model"] == "champion version 2"
    if same_models:
        assert after == before
    workspace, live = Workspace.open(tmp_path / "ws"), tmp_path / "live.csv"
    pd.DataFrame(dict(read_recording(tmp_path / "p4").columns)).to_csv(live, index=False)
    *_, end = follow_file(workspace, live, machine=MACHINE, idle_s=0.0)
    assert end["model"] == before["model"]
    assert monitor(workspace, "p0").model == before["model"], "what was said of a part before it was learnt from"


def test_the_band_does_not_learn_from_a_part_that_could_not_be_judged(plant):
    workspace = Workspace.open(plant / "ws")
    digest = Ledger(workspace.ledger).parts(MACHINE)[1]
    expect = Expectation.of(workspace, MACHINE)
    assert expect.band(1.0).parts == 4
    said = {"part": "p1", "digest": digest, "machine": MACHINE, "good": False, "alarms": []}
    book = Book(workspace, MACHINE)
    book.verdict(said)
    assert expect.band(1.0).parts == 3
    book.verdict({**said, "good": True})
    assert expect.band(1.0).parts == 4
