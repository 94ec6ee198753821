"""A recording that comes again with further columns completes the stored one; nothing stored changes or goes."""

import numpy as np
import pytest

from pido.core.part import PartInfo
from pido.core.recording import Recording
from pido.store import Store, content

N = 200


def part(name="p01", *, v_x=0.0, **columns):
    rng = np.random.default_rng(0)
    rows = {"time": np.arange(N) / 50, "curr_x": rng.normal(size=N), "v_x": v_x + rng.normal(size=N)}
    return Recording(PartInfo(part=name, machine="m", order=3), rows | {k: np.full(N, v) for k, v in columns.items()})


def test_columns_that_come_later_complete_the_part_and_what_was_stored_is_still_there(tmp_path, caplog):
    store = Store(tmp_path)
    first = store.add(part(mrr_sim=5.0))
    bytes_before = store.path(first.digest).read_bytes()
    now = store.add(part("another name", f_x_sim=7.0), source="b.csv")
    assert (now.part, now.order, now.new, now.gained) == ("p01", 3, False, ("f_x_sim",))
    assert "brings f_x_sim: they complete it" in caplog.text
    assert [e.digest for e in store.entries()] == [now.digest]
    whole = store.load(now.digest)
    assert (set(whole["mrr_sim"]), set(whole["f_x_sim"])) == ({5.0}, {7.0})
    assert now.digest == content.digest(whole)
    assert store.path(first.digest).read_bytes() == bytes_before
    assert "f_x_sim" not in store.load(first.digest)


def test_by_every_digest_that_it_had_a_part_is_found_as_it_is_now(tmp_path):
    store = Store(tmp_path)
    deliveries = [part(), part(f_x_sim=1.0), part(f_y_sim=2.0)]
    digests = [store.add(one).digest for one in deliveries]
    assert [store.add(one).digest for one in deliveries] == [digests[-1]] * 3
    assert not any(store.add(one).gained for one in deliveries)
    for digest in digests:
        entry = store.entry(digest)
        assert entry is not None
        assert entry.digest == digests[-1]
    assert set(store.before(digests[-1])) == set(digests[:2])
    assert store.today([*digests, "other"]) == {**dict.fromkeys(digests, digests[-1]), "other": "other"}
    assert set(store.as_kept(part())[0].columns) == {"time", "curr_x", "v_x", "f_x_sim", "f_y_sim"}


def test_a_column_that_was_empty_is_completed_too(tmp_path):
    store = Store(tmp_path)
    store.add(part(f_x_sim=np.nan))
    now = store.add(part(f_x_sim=7.0, f_y_sim=np.nan))
    assert now.gained == ("f_x_sim",)
    assert set(store.load(now.digest)["f_x_sim"]) == {7.0}


def test_where_another_column_is_not_as_stored_nothing_is_added_and_it_is_said_what_was_left_out(tmp_path, caplog):
    store = Store(tmp_path)
    first = store.add(part())
    again = store.add(part(v_x=0.1, f_x_sim=7.0, mrr_sim=5.0))
    assert (again.digest, again.gained) == (first.digest, ())
    assert "It brings f_x_sim, mrr_sim too, left out because v_x in it is not as stored" in caplog.text
    assert len(list(tmp_path.rglob("*.parquet"))) == 1


def test_two_that_complete_a_part_at_once_lose_nothing(tmp_path, monkeypatch):
    store = Store(tmp_path)
    store.add(part())
    plain = content.completed

    def overtaken(stored, again):
        monkeypatch.setattr(content, "completed", plain)
        found = plain(stored, again)
        Store(tmp_path).add(part(f_x_sim=1.0))
        return found

    monkeypatch.setattr(content, "completed", overtaken)
    now = store.add(part(f_y_sim=2.0))
    assert {"f_x_sim", "f_y_sim"} <= set(store.load(now.digest).columns)
    assert len(store.entries()) == 1


@pytest.mark.parametrize("later", [part(), part("p02")])
def test_what_brings_nothing_new_changes_nothing(tmp_path, later):
    store = Store(tmp_path)
    first = store.add(part(f_x_sim=7.0))
    again = store.add(later)
    assert (again.digest, again.new, again.gained) == (first.digest, False, ())
    assert "f_x_sim" in store.load(again.digest)
