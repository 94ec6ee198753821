"""Backup and restore of a plant's folder while it is written to: nothing is missing, whatever it is called."""

from __future__ import annotations

import sqlite3
import stat
import tarfile
from pathlib import Path

import pytest

from deploy import backup, postgres
from deploy.settings import PlantSettings, load
from pido.core.errors import PidoError


@pytest.fixture
def settings(tmp_path, monkeypatch) -> PlantSettings:
    monkeypatch.setattr(postgres, "dump", lambda settings, folder: None)  # `test_plant_database` has a real one
    found = load(tmp_path / "plant")
    found.workspace.mkdir()
    return found


def brought_back(settings: PlantSettings, place: Path) -> PlantSettings:
    """The plant as it is after a backup and a restore into `place`."""
    archive = place.with_suffix(".tar")
    backup.backup(settings, archive)
    assert stat.S_IMODE(archive.stat().st_mode) == 0o600
    backup.unpack(archive, place)
    return load(place)


def test_a_backup_holds_what_was_committed_while_a_database_is_in_use(settings, tmp_path):
    (settings.workspace / "store").mkdir()
    (settings.workspace / "store" / "part.parquet").write_bytes(b"rows")
    databases = ("ledger.db", "mlflow.db", "store/index.sqlite")
    held = []
    for name in databases:
        db = sqlite3.connect(settings.workspace / name)
        db.execute("PRAGMA journal_mode=WAL")
        db.execute("CREATE TABLE parts(digest TEXT)")
        db.execute("INSERT INTO parts VALUES ('abc')")
        db.commit()
        held.append(db)
    again = brought_back(settings, tmp_path / "again")
    for db in held:
        db.close()
    assert (again.workspace / "store" / "part.parquet").read_bytes() == b"rows"
    for name in databases:
        assert not (again.workspace / f"{name}-wal").exists(), "copied through SQLite, not as a file beside a journal"
        copy = sqlite3.connect(again.workspace / name)
        assert copy.execute("SELECT digest FROM parts").fetchall() == [("abc",)]
        copy.close()
    assert again.postgres_password == settings.postgres_password


def test_what_arrives_may_be_called_like_a_database_or_like_what_is_left_out(settings, tmp_path):
    files = (
        "store/rejected/Thumbs.db", "store/rejected/p7/tools.new", "inbox/work/part.json", "inbox/logs/late.db-wal",
        "inbox/watcher.alive", "registry/work/champion.json", "registry/derived/champion.json",
    )  # fmt: skip
    made_again = ("derived/a.parquet", "work/key/plan.json", "locks/m.lock", "watcher.alive")
    for name in (*files, *made_again):
        (settings.workspace / name).parent.mkdir(parents=True, exist_ok=True)
        (settings.workspace / name).write_bytes(b"\xd0\xcf\x11\xe0")
    (settings.workspace / "inbox" / "link").symlink_to("nowhere")
    again = brought_back(settings, tmp_path / "again").workspace
    found = {str(p.relative_to(again)) for p in again.rglob("*") if not p.is_dir()}
    assert found == {*files, "inbox/link"}


def test_a_damaged_database_is_named_and_the_older_backup_stays(settings, tmp_path):
    (settings.workspace / "ledger.db").write_bytes(b"no database" * 100)
    archive = tmp_path / "backup.tar"
    archive.write_bytes(b"of yesterday")
    with pytest.raises(PidoError, match=r"ledger\.db: cannot be copied"):
        backup.backup(settings, archive)
    assert archive.read_bytes() == b"of yesterday"


def test_a_backup_inside_the_plant_does_not_hold_itself(settings):
    (settings.workspace / "note").write_text("kept")
    for _ in range(2):
        backup.backup(settings, settings.folder / "backup.tar")
    with tarfile.open(settings.folder / "backup.tar") as tar:
        assert not [name for name in tar.getnames() if "tar" in name or "tmp" in name]
        assert "./workspace/note" in tar.getnames()


def test_a_backup_is_never_unpacked_over_something(settings, tmp_path):
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "file").write_text("precious")
    with pytest.raises(PidoError, match="not empty"):
        backup.unpack(tmp_path / "any.tar", tmp_path / "full")


def test_an_archive_that_climbs_out_of_its_folder_is_refused(tmp_path):
    import io

    evil = tmp_path / "evil.tar"
    with tarfile.open(evil, "w") as tar:
        entry = tarfile.TarInfo("../outside")
        entry.size = 1
        tar.addfile(entry, io.BytesIO(b"x"))
    with pytest.raises(PidoError, match="not a whole backup"):
        backup.unpack(evil, tmp_path / "place")
    assert not (tmp_path / "outside").exists()
