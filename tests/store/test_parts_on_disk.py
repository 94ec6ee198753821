import multiprocessing
import os
import signal
import sqlite3
import subprocess
import sys
import textwrap
import time

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pido.core.errors import StoreError
from pido.core.part import PartInfo
from pido.core.recording import Recording
from pido.store import Store
from pido.store.content import digest


def _part(name="p01", *, seed=0, n=200, machine="m", **about):
    rng = np.random.default_rng(seed)
    columns = {"time": np.arange(n) / 50, "curr_x": rng.normal(size=n), "v_x": rng.normal(size=n)}
    return Recording(PartInfo(part=name, machine=machine, **about), columns, ("a note",))


def test_what_was_added_comes_back_bit_for_bit(tmp_path):
    store = Store(tmp_path)
    part = _part(order=2, start_time_s=5.0).with_columns(tool_id=np.array(["a", None] * 100, object))
    part["curr_x"][3] = np.nan
    entry = store.add(part, source="p01")
    again = store.load(entry.digest)
    assert again.part == part.part
    assert again.notes == part.notes
    for name in part.columns:
        np.testing.assert_array_equal(again[name], part[name])
    assert set(store.load(entry.digest, ["v_x"]).columns) == {"time", "v_x"}


def test_the_same_content_is_stored_once_whatever_it_is_called(tmp_path):
    store = Store(tmp_path)
    first, second = store.add(_part(), source="a"), store.add(_part(), source="b")
    assert (first.new, second.new) == (True, False)
    assert first.digest == second.digest
    assert len(list(tmp_path.rglob("*.parquet"))) == len(store.entries()) == 1


def test_a_known_part_with_other_content_is_refused_and_the_store_stays(tmp_path):
    store = Store(tmp_path)
    store.add(_part())
    before = {p: p.read_bytes() for p in tmp_path.rglob("*.parquet")}
    with pytest.raises(StoreError, match=r"'p01'.*other content"):
        store.add(_part(seed=1))
    assert {p: p.read_bytes() for p in tmp_path.rglob("*.parquet")} == before
    store.add(_part(seed=1, machine="other"))
    assert len(store.entries()) == 2


@settings(max_examples=25, deadline=None)
@given(st.permutations(["time", "curr_x", "v_x"]))
def test_the_digest_does_not_depend_on_the_order_of_columns(names):
    part = _part()
    assert digest(Recording(part.part, {n: part[n] for n in names})) == digest(part)


def test_the_digest_sees_every_value_and_every_field():
    part, seen = _part(), {digest(_part())}
    changed = part["v_x"].copy()
    changed[100] = np.nextafter(changed[100], np.inf)
    seen.add(digest(part.with_columns(v_x=changed)))
    seen.add(digest(_part(material="S235JR")))
    seen.add(digest(part.with_columns(v_y=part["v_x"])))
    seen.add(digest(Recording(part.part, {"time": part.time, "v_x": part["curr_x"], "curr_x": part["v_x"]})))
    assert len(seen) == 5


def test_entries_come_in_production_order_however_they_arrived(tmp_path):
    said = [("c", {"order": 3}), ("d", {"start_time_s": 9.0}), ("a", {"order": 1}), ("e", {}), ("b", {"order": 2})]
    store = Store(tmp_path)
    for seed, (name, about) in enumerate(said):
        store.add(_part(name, seed=seed, **about))
    assert [e.part for e in store.entries()] == ["a", "b", "c", "d", "e"]


def test_a_rejected_part_lies_aside_with_its_reason_and_the_store_is_untouched(tmp_path):
    store = Store(tmp_path / "store")
    store.add(_part())
    for text in ("one", "two"):
        bad = tmp_path / "bad.csv"
        bad.write_text(text)
        place = store.reject(bad, "time goes backward")
        assert not bad.exists()
        assert place.read_text() == text
        assert "time goes backward" in place.with_name(f"{place.name}.reason.txt").read_text()
    assert len(store.entries()) == 1


def test_an_unknown_digest_and_a_damaged_file_are_clear_errors(tmp_path):
    store = Store(tmp_path)
    with pytest.raises(StoreError, match="no part with digest"):
        store.load("0" * 64)
    entry = store.add(_part())
    store.path(entry.digest).write_bytes(b"PAR1 cut off")
    with pytest.raises(StoreError, match="damaged"):
        store.load(entry.digest)


def _add_all(root, seeds):
    for seed in seeds:
        Store(root).add(_part(f"p{seed:02d}", seed=seed))


def test_processes_that_add_at_once_lose_and_double_nothing(tmp_path):
    context = multiprocessing.get_context("spawn")
    workers = [context.Process(target=_add_all, args=(tmp_path, range(k, k + 12))) for k in (0, 4, 8)]
    for worker in workers:
        worker.start()
    for worker in workers:
        worker.join(60)
        assert worker.exitcode == 0
    store = Store(tmp_path)
    assert [e.part for e in sorted(store.entries(), key=lambda e: e.part)] == [f"p{k:02d}" for k in range(20)]
    for entry in store.entries():
        assert digest(store.load(entry.digest)) == entry.digest


WRITER = textwrap.dedent(
    """
    import sys
    from pathlib import Path
    import numpy as np
    from pido.core.part import PartInfo
    from pido.core.recording import Recording
    from pido.store import Store
    store = Store(Path(sys.argv[1]))
    for k in range(10_000):
        values = np.random.default_rng(k).normal(size=20_000)
        store.add(Recording(PartInfo(part=f"p{k}", machine="m"), {"time": np.arange(20_000.0), "curr_x": values}))
        print(k, flush=True)
    """
)


@pytest.mark.parametrize("delay", [0.0, 0.013, 0.029])
def test_a_killed_writer_leaves_only_whole_parts(tmp_path, delay):
    with subprocess.Popen([sys.executable, "-c", WRITER, str(tmp_path)], stdout=subprocess.PIPE, text=True) as writer:
        assert writer.stdout is not None
        for _ in range(5):
            writer.stdout.readline()
        time.sleep(delay)
        os.kill(writer.pid, signal.SIGKILL)
        confirmed = 5 + len(writer.stdout.readlines())
    store = Store(tmp_path)
    entries = store.entries()
    assert len(entries) >= confirmed
    for entry in entries:
        assert digest(store.load(entry.digest)) == entry.digest
    for k in range(confirmed + 2):  # the writer starts again and comes through
        values = np.random.default_rng(k).normal(size=20_000)
        part = Recording(PartInfo(part=f"p{k}", machine="m"), {"time": np.arange(20_000.0), "curr_x": values})
        assert store.add(part).new == (k >= len(entries))


def test_the_same_samples_are_one_part_whatever_part_json_says_also_in_a_store_of_an_earlier_release(tmp_path, caplog):
    store, first = Store(tmp_path), _part("p01", order=1)
    known = store.add(first)
    for about in ({"part": "p99"}, {"order": 7}, {"part": "p98", "material": "S235JR"}):
        again = Recording(first.part.model_copy(update=about), first.columns)
        assert digest(again) != known.digest
        assert (store.add(again).digest, store.add(again).new) == (known.digest, False)
        assert "samples of 'p01'" in caplog.text
        caplog.clear()
        with sqlite3.connect(tmp_path / "index.sqlite") as index:
            index.execute("DROP TABLE signals")
    assert store.add(_part("p02", seed=1)).new
    assert store.add(Recording(first.part.model_copy(update={"machine": "other"}), first.columns)).new
    assert len(store.entries()) == 3
