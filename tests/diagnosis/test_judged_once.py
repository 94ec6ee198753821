"""What is known of a recording is worked out once, wherever it is asked for."""

import pickle

import numpy as np
import pytest

from pido.diagnosis import faults
from pido.diagnosis.faults import input_faults
from pido.diagnosis.signals import common_signals
from pido.diagnosis.state import axis_states
from tests.diagnosis.feeds import recordings
from tests.diagnosis.planted import part


def test_faults_of_a_recording_go_with_it_into_another_process_and_not_with_a_changed_copy(monkeypatch):
    good = next(iter(recordings()))
    jumped = good.with_columns(pos_x=good["pos_x"] + np.where(good.time > 20, 400.0, 0.0))
    found = input_faults(jumped)
    assert "pos_x" in found
    elsewhere = pickle.loads(pickle.dumps(jumped))
    monkeypatch.setattr(faults, "contradictions", None)  # judging anew would call it
    assert input_faults(elsewhere) == found
    with pytest.raises(TypeError):
        input_faults(jumped.with_columns(pos_x=good["pos_x"]))


def test_signals_of_some_rows_are_those_rows_of_all_signals():
    states = axis_states([part(k) for k in range(3)], "x")
    whole = common_signals(states)
    rows = np.arange(3, sum(len(s.time) for s in states), 7)
    some = common_signals(states, rows)
    assert list(some) == list(whole)
    for name, (values, unit) in some.items():
        np.testing.assert_array_equal(values, whole[name][0][rows])
        assert unit == whole[name][1]
