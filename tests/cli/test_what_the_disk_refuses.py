"""What the operating system refuses is one message with exit code 1: where, what, what to do; no part is to blame."""

import json
import os
import re
import shutil
import subprocess
import sys

import numpy as np
import pytest

from pido.core.errors import InputError, UnavailableError
from pido.core.files import writable
from pido.core.part import PartInfo
from pido.core.recording import Recording
from pido.recordings import read_recording
from pido.recordings.folder import write_folder

READ = """
import sys
from pido.recordings import read_recording
try:
    read_recording(sys.argv[1])
except Exception as error:
    print(type(error).__name__, error)
"""


@pytest.fixture
def part(tmp_path):
    t = np.arange(100) / 50
    columns = {"time": t, "pos_x": np.sin(t), "v_x": np.cos(t), "a_x": -np.sin(t), "curr_x": np.cos(3 * t)}
    return write_folder(Recording(PartInfo(part="p01", machine="m"), columns), tmp_path / "p01")


def unprivileged(*words):
    """`python WORDS` by somebody to whom permissions apply, which they do not to root."""
    plain = []
    if os.geteuid() == 0:
        if not shutil.which("setpriv"):
            pytest.skip("permissions do not apply to root, and there is no setpriv")
        plain = ["setpriv", "--bounding-set=-dac_override,-dac_read_search"]
    command = [*plain, sys.executable, *map(str, words)]
    return subprocess.run(command, capture_output=True, text=True, timeout=120)


@pytest.mark.parametrize("closed", ["recording.parquet", "part.json", "."])
def test_a_part_that_may_not_be_read_is_not_damaged(part, closed):
    (part / closed).chmod(0)
    done = unprivileged("-c", READ, part)
    (part / closed).chmod(0o700)
    assert re.search(r"^UnavailableError cannot be read now.*Give this user the right to it", done.stdout)


def test_a_file_that_may_not_be_read_is_not_called_unknown(tmp_path):
    file = tmp_path / "a.csv"
    file.write_text(",pos_x,v_x,curr_x\n0,1,1,1\n")
    file.chmod(0)
    assert f"UnavailableError cannot be read now. {file}: Permission denied" in unprivileged("-c", READ, file).stdout


WATCHED = """
import sys
from pido.arrivals import Arrived
from pido.backlog import Backlog
from pido.cli.watch import _in_this_process
from pido.departures import key_of
from pido.workspace import Workspace
workspace = Workspace.open(sys.argv[1])
take = _in_this_process(workspace, None, Backlog(workspace, workspace.inbox, iter(range(0, 10_000, 1000)).__next__))
for _ in range(3):
    take([Arrived(path, key_of(path), 1e9) for path in workspace.inbox.iterdir()])
"""


def test_a_bad_folder_that_may_not_be_moved_is_rejected_with_a_copy_and_why_it_stays_is_said(tmp_path):
    bad = tmp_path / "plant" / "inbox" / "bad"
    bad.mkdir(parents=True)
    (bad / "part.json").write_text("{}")
    bad.chmod(0o555)
    done = unprivileged("-c", WATCHED, tmp_path / "plant")
    bad.chmod(0o755)
    said = f"no recording.parquet. Copy the whole folder. It stays in the inbox. {bad}: Permission denied. Give this"
    assert done.stderr.count(said) == 3, done.stderr
    rejected = tmp_path / "plant" / "store" / "rejected"
    assert sorted(path.name for path in rejected.iterdir()) == ["bad", "bad.reason.txt"]
    assert [path.name for path in bad.parent.iterdir()] == ["bad"]
    status = subprocess.run(
        [sys.executable, "-m", "pido", "status", "-w", tmp_path / "plant"], capture_output=True, text=True, check=False
    )
    assert "no recording.parquet" in status.stdout


def test_a_part_that_may_not_be_read_is_not_moved_away(part, tmp_path):
    (part / "recording.parquet").chmod(0)
    done = unprivileged("-m", "pido", "ingest", part, "--store", tmp_path / "store")
    assert done.returncode == 1
    assert done.stderr.startswith("pido: cannot be read now")
    assert (part / "recording.parquet").exists()


@pytest.mark.parametrize("name", ["recording.parquet", "part.json"])
def test_a_folder_in_the_place_of_a_file_is_said(part, name, call):
    (part / name).unlink()
    (part / name).mkdir()
    code, _, err = call("ingest", part, "--store", part.parent / "store", "--keep")
    assert code == 1
    assert f"{name}: is no file, but a folder" in err


@pytest.mark.parametrize(
    "words",
    [
        "report plan plan.json --out OUT",
        "report iteration -w w --out OUT",
        "plan a.mpf --job job.toml -w w --out OUT",
        "experiment importance --out OUT",
    ],
)
def test_a_place_that_cannot_be_written_is_said_before_anything_is_computed(words, tmp_path, monkeypatch, call):
    monkeypatch.chdir(tmp_path)
    for name in ("plan.json", "a.mpf", "job.toml", "file"):
        (tmp_path / name).touch()
    code, _, err = call(*words.replace("OUT", "file/o").split())
    assert code == 1
    assert "cannot be written" in err
    assert "Something else is there: name another place." in err
    assert (tmp_path / "file").read_bytes() == b""


def test_a_place_that_may_not_be_written_is_said(tmp_path):
    (tmp_path / "shut").mkdir()
    (tmp_path / "plan.json").write_text(json.dumps({"part": "p", "bins": []}))
    (tmp_path / "shut").chmod(0o500)
    done = unprivileged(
        "-m", "pido", "report", "plan", tmp_path / "plan.json", "--out", tmp_path / "shut" / "new" / "o.html"
    )
    assert done.returncode == 1
    assert "Permission denied. Give this user the right to it, or name another place." in done.stderr


def test_asking_whether_a_file_can_be_written_leaves_nothing(tmp_path):
    (tmp_path / "old").write_text("old")
    for place in ("old", "new", "folder/new"):
        writable(tmp_path / place)
    assert [file.name for file in tmp_path.iterdir()] == ["old"]
    with pytest.raises(InputError, match="this is a folder"):
        writable(tmp_path)


def test_an_error_of_the_operating_system_has_no_traceback(part, call, tmp_path):
    (tmp_path / "store").write_text("no folder")
    code, _, err = call("ingest", part, "--store", tmp_path / "store" / "deeper")
    assert code == 1
    assert err.startswith(f"pido: {tmp_path / 'store'}")
    assert "Something else is there" in err


def test_a_recording_whose_disk_fails_is_unavailable(part, monkeypatch):
    def fails(*_args, **_more):
        raise OSError(5, "Input/output error")

    monkeypatch.setattr("pyarrow.parquet.read_table", fails)
    with pytest.raises(UnavailableError, match=r"Input/output error\. Mend that, then try again"):
        read_recording(part)
