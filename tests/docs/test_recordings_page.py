"""The page on recordings of one's own: its example runs, and what it lists is what there is."""

import json
import re
from itertools import product

import pytest

from pido.config import shipped
from pido.core.columns import UNITS
from pido.core.part import Operation, PartInfo, PartTool, UsedBefore, Workpiece
from pido.recordings import read_recording
from pido.recordings.check import check
from tests.docs.test_guides import GUIDE, blocks, follow

PAGE = GUIDE / "recordings.md"
TEXT = PAGE.read_text(encoding="utf-8")


@pytest.mark.thorough
def test_the_example_runs_without_a_fault_and_what_it_leaves_out_is_found(tmp_path):
    printed = follow(PAGE, tmp_path)
    assert check(read_recording(tmp_path / "parts" / "p01")) == ()
    assert printed["pido ingest parts/p01 --store store"].startswith("stored")
    found = printed["pido diagnose parts/p01 --out diagnosis"]
    assert re.search(r"^x\s+viscous_friction\s", found, re.MULTILINE)
    assert "y, z, sp   nothing significant" in found
    (finding,) = json.loads((tmp_path / "diagnosis" / "diagnosis.json").read_text(encoding="utf-8"))["findings"]
    low, high = finding["parameters"]["F_v"]["ci95"]
    assert low <= 0.02 <= high


def test_the_example_has_every_key_of_a_part():
    (shown,) = (json.loads(text) for kind, _, text in blocks(PAGE) if kind == "json")
    (tool,) = shown["tools"].values()
    for model, given in (
        (PartInfo, shown),
        (PartTool, tool),
        (UsedBefore, tool["used_before"]),
        (Workpiece, shown["workpiece"]),
        *((Operation, each) for each in shown["operations"]),
    ):
        assert set(given) == set(model.model_fields)


def test_every_column_and_every_material_is_on_the_page():
    named = set(re.findall(r"`([\w*]+)`", TEXT))
    every = {f"{what}_{axis}" for what, axis in product(("v", "a"), "xyz")}  # `v_*`, `a_*`
    of_all = {f"curr_{axis}{of}" for axis, of in product("yz", ("", "_sim"))}  # `curr_x` … `curr_sp`
    assert {"v_*", "a_*"} <= named
    assert set(UNITS) - every - of_all <= named
    materials = re.search(r"simulates: ([^.]*), or your own", TEXT)
    assert materials
    assert re.findall(r"`([^`]+)`", materials[1]) == sorted(shipped("materials"))
