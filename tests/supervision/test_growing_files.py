"""A file that is followed: what a recorder writes into it, and what becomes of it meanwhile."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pandas as pd
import pytest
from plain_parts import parts

from pido.core.errors import RecordingError
from pido.supervision.growing import Growing, blocks

ROWS = 300


@pytest.fixture(scope="module")
def tables() -> list[pd.DataFrame]:
    """Two parts of one machine, as a recorder would write them."""
    return [pd.DataFrame(dict(part.rows(slice(0, ROWS)).columns)) for part in parts(2)]


def _lines(table: pd.DataFrame) -> list[str]:
    return table.to_csv(index=False).splitlines(keepends=True)


def _times(file: Growing) -> list[float]:
    return [t for _, columns in blocks(file, 50.0, False) for t in columns["time"]]


def _followed(path: Path, *steps: Callable[[], object]) -> Growing:
    """A reader that meets one of these steps at each of its pauses, and goes on until nothing has come for a while."""
    left, now = list(steps), [0.0]

    def meanwhile(seconds: float) -> None:
        if left:
            left.pop(0)()
        else:
            now[0] += 1.0

    return Growing(path, 0.5, meanwhile, lambda: now[0])


def _replaced(path: Path, lines: list[str]) -> Callable[[], object]:
    """As a recorder does that writes beside it and renames."""

    def rename() -> None:
        (path.parent / "new").write_text("".join(lines))
        (path.parent / "new").rename(path)

    return rename


def _grown(path: Path, lines: list[str]) -> Callable[[], object]:
    def write() -> None:
        with path.open("a") as handle:
            handle.writelines(lines)

    return write


@pytest.mark.parametrize(
    ("row", "value", "said"),
    [(11, "", "time is missing in row 11"), (212, "nan", "time is missing in row 212"),
     (30, "0.56", "from row 29, 0.56 s, to row 30"), (212, "0.0", "goes backward in row 212"),
     (11, "12:00", "'time' holds what is not a number")],
)  # fmt: skip
def test_a_row_without_a_time_of_its_own_is_named(tables, tmp_path, row, value, said):
    table = tables[0].astype({"time": object})
    table.loc[row - 1, "time"] = value
    (tmp_path / "live.csv").write_text("".join(_lines(table)))
    with pytest.raises(RecordingError, match=said):
        _times(_followed(tmp_path / "live.csv"))


def test_time_that_is_rounded_to_more_than_a_step_is_said_to_be(tables, tmp_path):
    rounded = tables[0].assign(time=tables[0]["time"].round(1))
    (tmp_path / "live.csv").write_text("".join(_lines(rounded)))
    with pytest.raises(RecordingError, match=r"from row 1, 0 s, to row 2.*rounded.*thousandth"):
        _times(_followed(tmp_path / "live.csv"))


@pytest.mark.parametrize("beginning", ["\n", "\r\n\n"])
def test_empty_lines_before_the_names_of_columns_are_passed_over(tables, tmp_path, beginning):
    live = tmp_path / "live.csv"
    live.write_text(beginning)
    assert len(_times(_followed(live, _grown(live, _lines(tables[0]))))) == ROWS


def test_a_line_that_csv_does_not_allow_is_an_error_in_words(tables, tmp_path):
    lines = _lines(tables[0])
    lines[200] = "0\r1" + lines[200]
    (tmp_path / "live.csv").write_bytes("".join(lines).encode())
    with pytest.raises(RecordingError, match="no line of a CSV file"):
        _times(_followed(tmp_path / "live.csv"))


def test_the_next_part_under_the_same_name_ends_this_one_of_which_every_row_is_read(tables, tmp_path):
    live, lines, following = tmp_path / "live.csv", _lines(tables[0]), _lines(tables[1])
    live.write_text("".join(lines[:150]))

    def both() -> None:
        _grown(live, lines[150:])()
        _replaced(live, following[:260])()

    file = _followed(live, both)
    assert _times(file) == tables[0]["time"].tolist()
    assert file.replaced
    again = _followed(live)
    assert len(_times(again)) == 259
    assert not again.replaced


@pytest.mark.parametrize("rows", [60, 299])
def test_a_next_part_that_is_written_over_this_one_ends_it(tables, tmp_path, rows):
    live = tmp_path / "live.csv"
    live.write_text("".join(_lines(tables[0])[:201]))
    file = _followed(live, lambda: live.write_text("".join(_lines(tables[1])[: rows + 1])))
    assert len(_times(file)) == 200
    assert file.replaced


def test_a_next_part_of_which_only_the_names_of_columns_are_there_ends_this_one_with_its_first_row(tables, tmp_path):
    live, following = tmp_path / "live.csv", _lines(tables[1])
    live.write_text("".join(_lines(tables[0])[:201]))
    file = _followed(live, _replaced(live, following[:1]), _grown(live, following[1:2]))
    assert len(_times(file)) == 200
    assert file.replaced


def test_a_copy_that_is_brought_up_to_date_goes_on(tables, tmp_path):
    live, lines = tmp_path / "live.csv", _lines(tables[0])
    live.write_text("".join(lines[:100]))
    steps = [
        _replaced(live, lines[:200]),
        live.unlink,
        _replaced(live, lines[:201]),
        lambda: live.write_text(""),
        lambda: live.write_text("".join(lines[:120])),
        lambda: live.write_text("".join(lines)),
    ]
    file = _followed(live, *steps)
    assert _times(file) == tables[0]["time"].tolist()
    assert not file.replaced


def test_a_recorded_load_is_no_air_cut_and_what_is_missing_beside_it_is_not_taken_as_nothing(tables, tmp_path):
    path = tmp_path / "part.csv"
    pushed = tables[0].drop(columns=["f_sp_sim", "mrr_sim"]).assign(f_x_sim=264.9)
    path.write_text("".join(_lines(pushed)))
    with pytest.raises(RecordingError, match=r"mrr_sim cannot be taken as 0.*f_x_sim is up to 264.9 N"):
        list(blocks(_followed(path), 50.0, True))
    path.write_text("".join(_lines(pushed.assign(mrr_sim=5.0))))
    assert all((columns["f_x_sim"] == 264.9).all() for _, columns in blocks(_followed(path), 50.0, True))
