"""A part whose currents are in another unit than those of the other parts is not taken in as if nothing were."""

import logging
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from hypothesis import given
from hypothesis import strategies as st
from plain_parts import parts, with_simulation

from pido.cli import pido
from pido.core.axes import AXES
from pido.core.columns import CURRENT
from pido.core.errors import StoreError
from pido.core.recording import Recording
from pido.parts import Refused, ingest, look_at
from pido.recordings.folder import write_folder
from pido.store import Store
from pido.store.sizes import beside, sizes
from pido.workspace import Workspace

MADE = [part.rows(slice(0, 700)) for part in parts(4)]
BY_AXIS = st.fixed_dictionaries({axis: st.floats(0.01, 50.0) for axis in AXES})


def times(recording: Recording, factor: float, axes: tuple[str, ...] = AXES) -> Recording:
    """The recorded currents of some axes as they would stand in another unit; what was simulated stays in A."""
    return recording.with_columns(**{CURRENT[axis]: recording[CURRENT[axis]] * factor for axis in axes})


@pytest.fixture
def store(tmp_path) -> Store:
    store = Store(tmp_path / "store")
    for recording in MADE[:2]:
        store.add(recording)
    return store


@pytest.mark.parametrize(
    ("factor", "said"), [(1000.0, r"are \d{3,4} times .* mA.* divide"), (1e-3, "multiply .* 1000")]
)
def test_currents_of_all_axes_a_thousand_times_off_are_refused_with_part_factor_and_what_to_do(store, factor, said):
    with pytest.raises(StoreError, match=said) as error:
        store.add(times(MADE[2], factor))
    for named in (MADE[2].part.part, MADE[0].part.part, MADE[1].part.part):
        assert named in str(error.value)
    assert len(store.entries()) == 2
    store.add(MADE[2])


def test_one_stored_part_is_enough_to_compare_with_and_the_simulation_does_not_matter(tmp_path):
    store = Store(tmp_path)
    store.add(with_simulation(MADE[0]))
    with pytest.raises(StoreError, match="mA"):
        store.add(times(with_simulation(MADE[1]), 1000.0))


def test_the_first_part_of_a_machine_is_beside_nothing(tmp_path):
    assert Store(tmp_path).add(times(MADE[0], 1000.0)).new


@pytest.mark.parametrize(("factor", "warned"), [(5.0, False), (1 / 5.0, False), (40.0, True), (1 / 40.0, True)])
def test_a_load_is_no_oddity_and_a_smaller_one_is_warned_of_and_taken_in(store, caplog, factor, warned):
    with caplog.at_level(logging.WARNING):
        assert store.add(times(MADE[2], factor)).new
    assert ("look at the export" in caplog.text) is warned


def test_one_axis_that_is_off_is_not_for_this_check(store, caplog):
    with caplog.at_level(logging.WARNING):
        assert store.add(times(MADE[2], 1000.0, ("sp",))).new
    assert not caplog.text


def test_an_axis_that_stands_throughout_says_nothing():
    """It holds what it likes: the noise of its sensor, or a weight."""
    other = MADE[2]
    still = {"v_y": np.zeros(len(other)), CURRENT["y"]: np.full(len(other), 1e-3)}
    standing = sizes(other.with_columns(**still))
    assert set(standing) == set(sizes(other)) - {"y"}
    assert {"x", "sp"} <= set(standing)
    found = beside("p", sizes(times(other, 1000.0).with_columns(**still)), {"q": sizes(MADE[0])})
    assert found is not None
    assert found.unit


def test_a_few_samples_in_motion_say_nothing():
    few = MADE[0].rows(slice(0, 700)).with_columns(**{f"v_{axis}": np.zeros(700) for axis in AXES})
    assert sizes(few) == {}
    assert beside("p", {}, {"q": sizes(MADE[1])}) is None


@given(mine=BY_AXIS, others=st.lists(BY_AXIS, min_size=1, max_size=5))
def test_what_is_said_of_a_part_in_ma_is_the_opposite_of_what_is_said_the_other_way_round(mine, others):
    stored = {f"q{k}": one for k, one in enumerate(others)}
    up = beside("p", {axis: 1e6 * size for axis, size in mine.items()}, stored)
    down = beside("p", {axis: 1e-6 * size for axis, size in mine.items()}, stored)
    assert up is not None
    assert down is not None
    assert up.factor / down.factor == pytest.approx(1e12)


def test_a_workspace_refuses_it_on_every_way_in(tmp_path):
    root = tmp_path / "plant"
    folders = [write_folder(one, tmp_path / one.part.part) for one in (MADE[0], times(MADE[1], 1000.0))]
    ingest(str(root), str(folders[0]))
    with pytest.raises(Refused, match="mA"):
        ingest(str(root), str(folders[1]))
    with pytest.raises(StoreError, match="mA"):
        look_at(Workspace.open(root), folders[1])
    ingest(str(root), str(write_folder(MADE[1], tmp_path / "right")))


def test_ingest_puts_it_aside_with_the_reason(tmp_path: Path):
    folders = [write_folder(one, tmp_path / one.part.part) for one in (MADE[0], times(MADE[1], 1000.0))]
    answer = CliRunner().invoke(pido, ["ingest", *map(str, folders), "--store", str(tmp_path / "store")])
    assert answer.exit_code == 1
    assert "divide" in answer.stderr
    (reason,) = (tmp_path / "store" / "rejected").glob("*.reason.txt")
    assert "divide" in reason.read_text()
