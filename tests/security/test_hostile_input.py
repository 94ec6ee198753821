"""Nothing that arrives is executed or trusted: links, deep JSON, endless programs, pickled objects, names with code."""

from __future__ import annotations

import json
import os
import pickle
import resource
import subprocess
import sys
import tarfile
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from deploy import backup
from pido.core.errors import PidoError, RegistryError
from pido.recordings import read_recording
from pido.tracking import bundle, model_files


class _Trap:
    """Leaves a file behind when it is unpickled."""

    def __init__(self, place: Path) -> None:
        self.place = place

    def __reduce__(self):
        return (Path.touch, (self.place,))


def part_folder(root: Path, about: str, table: pa.Table) -> Path:
    root.mkdir()
    (root / "part.json").write_text(about)
    pq.write_table(table, root / "recording.parquet")
    return root


def test_pickled_objects_in_a_parquet_file_are_never_opened(tmp_path):
    sprung = tmp_path / "sprung"
    trap = pickle.dumps(_Trap(sprung))
    columns = {"time": [0.0, 0.02], "curr_x": pa.array([trap, trap], pa.binary())}
    table = pa.table(columns).replace_schema_metadata({"pandas": trap, "pido": trap})
    about = json.dumps({"part": "p", "machine": "m"})
    with pytest.raises(PidoError, match="curr_x"):
        read_recording(part_folder(tmp_path / "p", about, table), machine="m")
    assert not sprung.exists()


def test_a_model_file_with_a_pickle_in_it_is_refused_unopened(tmp_path):
    sprung = tmp_path / "sprung"
    with pytest.raises(RegistryError, match="not loaded"):
        model_files.load(pickle.dumps(_Trap(sprung)))
    assert not sprung.exists()


def test_a_model_file_that_was_swapped_is_not_loaded(tmp_path):
    made = bundle.save(tmp_path, {"machine": "m"}, {"x.skops": b"ours"})
    (made.folder / "x.skops").write_bytes(b"theirs")
    with pytest.raises(RegistryError, match="not the file that was registered"):
        made.read("x.skops")


@pytest.mark.parametrize("text", ["[" * 200_000, '{"a":' * 200_000, '{"Header": ' + "[" * 50_000 + "]" * 50_000 + "}"])
def test_json_nested_without_end_is_an_error_in_words_not_a_crash(tmp_path, text):
    place = tmp_path / "bomb.json"
    place.write_text(text)
    with pytest.raises(PidoError):
        read_recording(place, machine="m")


def test_a_backup_with_a_path_that_climbs_writes_nothing_outside_its_folder(tmp_path):
    evil = tmp_path / "evil.tar"
    source = tmp_path / "x"
    source.write_text("x")
    with tarfile.open(evil, "w") as tar:
        tar.add(source, arcname="../climbed")
    with pytest.raises(PidoError, match="not a whole backup"):
        backup.unpack(evil, tmp_path / "inner" / "new")
    assert not (tmp_path / "inner" / "climbed").exists()


@pytest.mark.parametrize(
    "program", ["N10 GOTOB N10\n", "A:\nGOTOB A\nM30\n", "WHILE 1\nENDWHILE\nM30\n", "LOOP\nENDLOOP\n"]
)
def test_an_nc_program_that_never_ends_is_stopped(tmp_path, program):
    place = tmp_path / "endless.mpf"
    place.write_text(program)
    code = (
        "import sys; from pathlib import Path; from pido.nc import interpret; from pido.core.errors import PidoError\n"
        "try:\n    interpret(Path(sys.argv[1]))\nexcept PidoError as e:\n    print('refused', e)\n"
    )
    limit = (40, 40)
    done = subprocess.run(
        [sys.executable, "-c", code, str(place)], capture_output=True, text=True, check=False,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_CPU, limit), env=os.environ.copy(),
    )  # fmt: skip
    assert done.returncode == 0, done.stderr[-500:]
    assert "refused" in done.stdout
