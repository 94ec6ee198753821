"""`pido ingest` with good and bad input: what is kept, what is set aside, what is said."""

import json

import numpy as np
import pytest
from click.testing import CliRunner

from pido.cli.ingest import command
from pido.core.part import PartInfo
from pido.core.recording import Recording
from pido.recordings.folder import write_folder
from pido.store import Store

N = 500


def _part(root, name="p01", seed=0, **change):
    rng = np.random.default_rng(seed)
    t = np.arange(N) / 50
    columns = {"time": t}
    for axis in ("x", "y", "z", "sp"):
        w = 2.0
        columns |= {f"pos_{axis}": 100 + 30 * np.sin(w * t), f"v_{axis}": 30 * w * np.cos(w * t)}
        columns |= {f"a_{axis}": -30 * w * w * np.sin(w * t), f"curr_{axis}": rng.normal(size=N)}
    columns |= change
    columns = {k: v for k, v in columns.items() if v is not None}
    return write_folder(Recording(PartInfo(part=name, machine="m"), columns), root / name)


def _run(store, *args):
    result = CliRunner().invoke(command, [*map(str, args), "--store", str(store), "--json"], catch_exceptions=False)
    return result.exit_code, [json.loads(line) for line in result.stdout.splitlines()]


def test_a_good_part_is_stored_once(tmp_path):
    part = _part(tmp_path)
    code, (row,) = _run(tmp_path / "store", part)
    assert (code, row["state"], row["samples"], row["faults"]) == (0, "stored", N, [])
    code, (again,) = _run(tmp_path / "store", part)
    assert (code, again["state"], again["digest"]) == (0, "known", row["digest"])


def test_process_quantities_that_come_later_complete_the_stored_part_and_it_is_said(tmp_path):
    part, later = _part(tmp_path), _part(tmp_path / "later", f_x_sim=np.ones(N), mrr_sim=np.ones(N))
    _run(tmp_path / "store", part)
    code, (row,) = _run(tmp_path / "store", later)
    assert (code, row["state"], row["part"]) == (0, "completed", "p01")
    assert any("stored without f_x_sim, mrr_sim" in note for note in row["notes"])
    assert {"f_x_sim", "mrr_sim"} <= set(Store(tmp_path / "store").load(row["digest"]).columns)


def _truncated(folder):
    file = folder / "recording.parquet"
    file.write_bytes(file.read_bytes()[:1000])


def _emptied(folder):
    for file in folder.iterdir():
        file.unlink()


def _misspelt(folder):
    (folder / "part.json").write_text('{"part": "p02", "machine": "m", "materail": "steel"}')


T = np.arange(N) / 50
BAD = {
    "a column is missing": ({"curr_y": None}, None, "curr_y"),
    "a column is unknown": ({"curr_q": np.zeros(N)}, None, "curr_q"),
    "a unit is wrong": ({"v_x": 60 * 60 * np.cos(2 * T)}, None, "mm/min"),
    "time goes backward": ({"time": np.r_[T[:300], T[:200]]}, None, "backward"),
    "the tool never cuts": ({"mrr_sim": np.zeros(N)}, None, "engaged"),
    "the file is cut off": ({}, _truncated, "damaged or cut off"),
    "the folder is empty": ({}, _emptied, "empty"),
    "a key is misspelt": ({}, _misspelt, "materail"),
    "the part is known with other content": ({"curr_x": np.ones(N) + T}, "p01", "other content"),
}


@pytest.mark.parametrize("case", BAD)
def test_a_bad_part_is_set_aside_with_one_clear_reason_and_the_store_is_untouched(tmp_path, case):
    change, damage, word = BAD[case]
    store = tmp_path / "store"
    _run(store, _part(tmp_path / "good"))
    before = Store(store).entries()
    bad = _part(tmp_path, damage if isinstance(damage, str) else "p02", seed=1, **change)
    if callable(damage):
        damage(bad)
    code, (row,) = _run(store, bad, "--cutting")
    assert code == 1
    assert row["state"] == "rejected"
    assert word in row["reason"]
    assert not bad.exists()
    aside = store / "rejected" / bad.name
    assert aside.is_dir()
    assert word in aside.with_name(f"{aside.name}.reason.txt").read_text()
    assert Store(store).entries() == before


def test_one_bad_part_does_not_keep_the_others_out(tmp_path):
    parts = [_part(tmp_path, "a", 1), _part(tmp_path, "b", 2, curr_x=None), _part(tmp_path, "c", 3)]
    code, rows = _run(tmp_path / "store", *parts)
    assert code == 1
    assert [row["state"] for row in rows] == ["stored", "rejected", "stored"]
