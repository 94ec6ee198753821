"""What README and pages say is so: commands run, tables are those of the code, the reference builds."""

import json
import os
import re
import runpy
import subprocess
import sys
from pathlib import Path

import pytest

import pido.nc
from pido.cli import VERBS
from pido.diagnosis.mechanisms import CATALOGUE
from pido.recordings import READERS

ROOT = Path(__file__).parents[2]
README = (ROOT / "README.md").read_text(encoding="utf-8")
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]


@pytest.mark.thorough
def test_the_commands_of_the_readme_run_and_print_what_it_shows(tmp_path):
    (block,) = re.findall(r"```console\n(.*?)```", README, re.DOTALL)
    environment = {**os.environ, "PATH": f"{Path(sys.executable).parent}:{os.environ['PATH']}", "PYTHONPATH": str(ROOT)}
    said = ""
    for line in block.splitlines():
        command = line.removeprefix("$ ")
        done = subprocess.run(
            ["bash", "-ec", command], cwd=tmp_path, env=environment, capture_output=True, text=True, timeout=600
        )
        assert done.returncode == 0, f"{command}\n{done.stderr}"
        said = done.stdout
    shown = re.findall(r"^    (\w+)   (\w+)   ", README, re.MULTILINE)
    assert shown
    for axis, mechanism in shown:
        assert re.search(rf"^{axis}\s+{mechanism}\s", said, re.MULTILINE)
    assert (tmp_path / "diagnosis" / "report.html").exists()


@pytest.mark.parametrize("target", ["demo", "test", "test-thorough", "test-slow", "docs", "plant"])
def test_every_make_target_that_is_named_exists(target):
    assert re.search(rf"^{target}:", (ROOT / "Makefile").read_text(encoding="utf-8"), re.MULTILINE)
    assert any(f"make {target}" in page.read_text(encoding="utf-8") for page in PAGES)


def test_the_readme_lists_every_format_that_is_read():
    for reader in READERS:
        assert f"| {reader.name} | {reader.layout} |" in README


def test_the_readme_says_which_nc_words_are_understood():
    assert pido.nc.__doc__
    flat = " ".join(README.split())
    for sentence in pido.nc.__doc__.split("\n\n")[1:]:
        # the module names its tables by their import path, the README by their file
        assert " ".join(sentence.split())[:200] in flat


def test_every_file_that_a_page_names_is_there():
    for page in PAGES:
        for name in re.findall(r"`((?:pido|docs|flows|deploy|tests)/[\w./-]+)`", page.read_text(encoding="utf-8")):
            assert (ROOT / name).exists(), f"{page.name} names {name}"


def test_every_verb_that_a_page_calls_exists():
    for page in PAGES:
        for verb in re.findall(r"(?:^\$ |^    |`)pido ([a-z][a-z-]+)", page.read_text(encoding="utf-8"), re.MULTILINE):
            assert verb in VERBS, f"{page.name} calls pido {verb}"


def test_the_page_on_physics_is_made_of_the_catalogue_and_of_what_was_measured():
    script = runpy.run_path(str(ROOT / "docs" / "physics_examples.py"))
    measured = json.loads((ROOT / "docs" / "physics_examples.json").read_text(encoding="utf-8"))
    page = (ROOT / "docs" / "physics.md").read_text(encoding="utf-8")
    assert page == script["page"](measured), "run: python docs/physics_examples.py --only-page"
    for mechanism in CATALOGUE:
        assert f"### `{mechanism.id}`" in page


@pytest.mark.slow
def test_the_reference_builds_without_a_warning(tmp_path):
    done = subprocess.run(
        [sys.executable, ROOT / "docs" / "reference.py", tmp_path],
        capture_output=True,
        text=True,
        timeout=900,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
    )
    assert done.returncode == 0, done.stderr
    assert "PiDOSampler" in (tmp_path / "pido" / "sampling" / "front.html").read_text(encoding="utf-8")
