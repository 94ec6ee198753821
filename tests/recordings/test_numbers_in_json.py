"""Tables read straight from JSON text, against Python's own parser."""

import json

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from simdjson import Parser

from pido.recordings import numbers

WIDTH, WANTED = 3, (0, 2, 0)
RECORDED = st.decimals(-(10**8), 10**8, places=6).map(str) | st.integers(-(10**15), 10**15).map(str)
ODD = st.floats(allow_nan=False, allow_infinity=False).map(repr) | st.sampled_from(
    ["-0", "-0.0", "1e5", "1E-07", "2.5e+22", "9007199254740993", "0.1e23", "123456789012345678", "1" * 30, "7e99"]
)
NO_NUMBER = st.sampled_from(
    ["", "01", "1.", ".5", "+1", "1e", "--1", "null", "true", '"1"', "[1]", "{}", "NaN", "1 2", "0x1"]
)


def table(line, width, wanted):
    return numbers.table(line, width, wanted, Parser())


def _line(rows, comma=","):
    return f'{{"HFData":[{comma.join("[" + comma.join(row) + "]" for row in rows)}]}}'.encode()


def _by_python(line):
    return np.array([[row[i] for i in WANTED] for row in json.loads(line)["HFData"]], float)


def rows_of(number):
    return st.lists(st.lists(number, min_size=WIDTH, max_size=WIDTH), min_size=1, max_size=4)


@given(rows_of(RECORDED), st.sampled_from([",", ", ", " , "]))
def test_what_a_control_writes_is_read_to_the_last_bit(rows, comma):
    line = _line(rows, comma)
    np.testing.assert_array_equal(table(line, WIDTH, WANTED), _by_python(line), strict=True)


@given(rows_of(RECORDED | ODD))
def test_a_number_that_is_hard_to_round_is_left_to_the_general_parser_or_rounded_as_it_does(rows):
    read = table(_line(rows), WIDTH, WANTED)
    if read is not None:
        np.testing.assert_array_equal(read, _by_python(_line(rows)))


@given(rows_of(RECORDED), st.data())
def test_no_table_is_seen_where_the_text_is_no_json_or_no_table(rows, data):
    line = bytearray(_line(rows))
    for _ in range(data.draw(st.integers(1, 3))):
        at = data.draw(st.integers(0, len(line) - 1))
        line[at : at + data.draw(st.integers(0, 2))] = data.draw(
            st.sampled_from(list(b'[]{},.-+eE 0"1\n')).map(chr)
        ).encode()
    read = table(bytes(line), WIDTH, WANTED)
    if read is not None:
        assert {len(row) for row in json.loads(bytes(line))["HFData"]} == {WIDTH}
        np.testing.assert_array_equal(read, _by_python(bytes(line)))


@given(rows_of(RECORDED), NO_NUMBER, st.data())
def test_a_cell_that_is_no_number_is_refused_in_every_column(rows, cell, data):
    rows[data.draw(st.integers(0, len(rows) - 1))][data.draw(st.integers(0, WIDTH - 1))] = cell
    assert table(_line(rows), WIDTH, WANTED) is None


@given(rows_of(RECORDED), st.data())
def test_a_row_of_another_length_is_refused(rows, data):
    row = rows[data.draw(st.integers(0, len(rows) - 1))]
    if data.draw(st.booleans()):
        row.append("1")
    else:
        row.pop()
    assert table(_line(rows), WIDTH, WANTED) is None


def test_other_messages_and_lines_that_are_cut_off_are_refused():
    whole = _line([["1", "2", "3"]])
    assert table(whole, WIDTH, WANTED) is not None
    assert all(table(whole[:cut], WIDTH, WANTED) is None for cut in range(len(whole)))
    assert table(b'{"HFData":[]}', WIDTH, WANTED) is None
    assert table(b'{"HFData":[[1,2,3]],"HFNovelty":{}}', WIDTH, WANTED) is None
    assert table(b'{"HFBlockEvent":{"HFProbeCounter":1}}', WIDTH, WANTED) is None
