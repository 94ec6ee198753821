"""Backup and restore of a plant's folder while it is written to: nothing is missing, whatever it is called."""

from __future__ import annotations

import itertools
import sqlite3
import stat
import tarfile
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from deploy import backup, postgres
from deploy.settings import PlantSettings, load
from pido import departures
from pido.core.errors import PidoError
from pido.core.part import PartInfo
from pido.core.recording import Recording
from pido.store import Store
from pido.tracking import bundle, promotion
from pido.tracking.ledger import Ledger
from pido.workspace import Workspace, arrival_digest

MACHINE = "mill 1"


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


def test_a_part_that_is_done_while_a_backup_is_made_gets_its_turn_after_a_restore(settings, tmp_path):
    place = Workspace.open(settings.workspace)
    delivered: set[str] = set()
    with working(place, tmp_path / "staging", delivered):
        for number in range(60):
            if number >= 8 and len(Ledger(place.ledger).parts(MACHINE)) > 8:
                break
            again = Workspace.open(brought_back(settings, tmp_path / f"again{number}").workspace)
            ledger, store = Ledger(again.ledger), Store(again.store)
            done, stored = set(ledger.parts(MACHINE)), {entry.digest: entry for entry in store.entries()}
            waiting = {path.name: arrival_digest(path) for path in again.inbox.iterdir()}
            assert {stored[digest].source for digest in stored.keys() - done} <= waiting.keys()
            assert set(waiting.values()) <= delivered, "whole, or not there"
            for arrival in again.taken.iterdir() if again.taken.exists() else ():
                known = ledger.arrival(arrival_digest(arrival))
                assert known is not None, arrival.name
                assert known.part in done, arrival.name
            assert all(len(store.load(digest)) for digest in done), "what is done has its recording"
            known_versions = {standing.version.version for standing in promotion.standings(again, MACHINE)}
            assert {decision.version for decision in promotion.history(again, MACHINE)} <= known_versions
    assert len(Ledger(place.ledger).parts(MACHINE)) > 8, "the plant was at work all the time"


@contextmanager
def working(place: Workspace, staging: Path, delivered: set[str]) -> Iterator[None]:
    """Parts that arrive, are done and put away, and versions that are approved, one after another, while the block
    runs: what ingestion, iteration and decision write, in their order."""
    ledger, store = Ledger(place.ledger), Store(place.store)
    place.inbox.mkdir()
    ended, faults = threading.Event(), []

    def one(number: int) -> None:
        arrival = place.inbox / f"p{number}"
        (staging / arrival.name).mkdir(parents=True)
        for name in ("part.json", "recording.parquet"):
            (staging / arrival.name / name).write_bytes(name.encode() * 2000 + arrival.name.encode())
        key = arrival_digest(staging / arrival.name)
        delivered.add(key)
        (staging / arrival.name).rename(arrival)
        part = PartInfo(part=arrival.name, machine=MACHINE)
        stored = store.add(Recording(part, {"time": np.arange(60) / 50.0}), source=arrival.name)
        ledger.took(key, arrival.name, stored.digest)
        models = {"x.skops": arrival.name.encode()}
        made = bundle.save(place.bundles, {"machine": MACHINE, "parts": [stored.digest]}, models)
        gate = {"passed": True, "words": ""}
        version = ledger.finished(arrival.name, MACHINE, stored.digest, arrival.name, made.digest, gate, {})
        departures.put_away(place, arrival, key)
        promotion.approve(place, MACHINE, version, by="A. Ito", reason="it passed")

    def on_and_on() -> None:
        try:
            for number in itertools.takewhile(lambda _: not ended.is_set(), itertools.count()):
                one(number)
        except BaseException as error:
            faults.append(error)

    thread = threading.Thread(target=on_and_on)
    thread.start()
    try:
        yield
    finally:
        ended.set()
        thread.join()
    assert not faults


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
