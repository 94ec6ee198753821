"""Which tool cuts is said by the column, or by tool_changes of part.json; where neither says, nothing is assumed."""

import numpy as np
import pytest

from pido.core.errors import RecordingError, SettingsError
from pido.core.machining import Tool
from pido.core.part import ToolChange
from pido.core.recording import Recording
from pido.core.spindle_tool import tool_in_spindle
from tests.process.test_quantities_and_samples import TOOLS, quantities, recorded, slot

TWO = {**TOOLS, "6": Tool("6", 6.0, 2)}
CHANGE_S = 4.0


def changed(*changes, **columns):
    """A slot in which the cutter changes on the way."""
    plain = recorded(slot(), **columns)
    told = tuple(ToolChange(t=t, tool_id=name) for t, name in changes)
    return Recording(plain.part.model_copy(update={"tool_changes": told}), plain.columns)


def test_tool_changes_cut_as_the_column_does():
    by_changes = changed((CHANGE_S, 6), (0.0, "T10"))
    names = np.where(by_changes.time < CHANGE_S, "T10", "6").astype(object)
    assert tool_in_spindle(by_changes).tolist() == names.tolist()
    one, other = quantities(by_changes, tools=TWO), quantities(changed(tool_id=names), tools=TWO)
    for name in ("mrr_sim", "f_x_sim", "m_sp_sim"):
        np.testing.assert_array_equal(one[name], other[name])
    late = one["mrr_sim"][by_changes.time > CHANGE_S + 1.0]
    assert late.max() < 0.7 * one["mrr_sim"].max()  # 6 of 10 mm


def test_a_spindle_that_turns_with_a_tool_that_nobody_names_is_refused():
    with pytest.raises(RecordingError, match=r"before the first of tool_changes \(t = 4 s\).*with t = 0"):
        quantities(changed((CHANGE_S, 6)), tools=TWO)
    still = np.where(recorded(slot()).time < CHANGE_S, 0.0, 19_200.0)
    assert not quantities(changed((CHANGE_S, 6), v_sp=still), tools=TWO)["mrr_sim"][:100].any()
    with pytest.raises(SettingsError, match="tool_changes"):
        quantities(recorded(slot()), tools=TWO)


def test_the_only_tool_of_a_part_is_in_the_spindle_from_the_start():
    with_change, plain = quantities(changed((CHANGE_S, "T10"))), quantities(recorded(slot()))
    np.testing.assert_array_equal(with_change["mrr_sim"], plain["mrr_sim"])
    with pytest.raises(SettingsError, match="7 are not in the list"):
        quantities(changed((0.0, 7)))
