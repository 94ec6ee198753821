"""A wheel from a clean tree, in an environment of its own: what a person gets from `pip install .`, on each Python.

Needs uv and a package index (or uv's cache); says so where one of them is missing.
"""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

import pido

ROOT = Path(__file__).parents[2]
AWAY = re.compile(r"dns error|failed to lookup|error sending request|Network is unreachable|Connection refused", re.I)

USED = """
import importlib.util, sys
from pathlib import Path
import numpy as np
import pido
from pido.core.part import PartInfo
from pido.core.recording import Recording
from pido.diagnosis.estimator import MismatchCorrection
from pido.equations.estimators import LocalPhysicalEquations, PhysicalEquation
from pido.nc import interpret
from pido.recordings.folder import write_folder
from pido.sampling.front import PiDOSampler

assert interpret("G0 X0 Y0 Z0\\nG1 X30 Y40 F600\\nM30").length.tolist() == [50.0]
t = np.arange(600) * 0.02
columns = {"time": t, "pos_x": np.sin(t), "v_x": np.cos(t), "curr_x": np.cos(t) + 0.2 * np.sin(3 * t)}
write_folder(Recording(PartInfo(part="p1", machine="cmx600v", order=1), columns), Path(sys.argv[1]))
assert not {"prefect", "mlflow"} & set(sys.modules)
assert not [name for name in ("prefect", "mlflow", "optuna", "dask", "pytest") if importlib.util.find_spec(name)]
print(pido.__version__)
"""


def done(*words: object, code: int = 0, cwd: Path | None = None) -> str:
    """What a command prints; the test is skipped where it needs an index that cannot be reached."""
    end = subprocess.run([str(word) for word in words], capture_output=True, text=True, cwd=cwd, timeout=900)
    if end.returncode != code and AWAY.search(end.stderr):
        pytest.skip(f"no package index: {end.stderr.strip().splitlines()[-1]}")
    assert end.returncode == code, f"{words}\n{end.stdout}\n{end.stderr}"
    return end.stdout + end.stderr


@pytest.fixture(scope="module")
def uv():
    """uv, as `make setup` installs it beside this Python, or from the PATH."""
    found = shutil.which("uv", path=str(Path(sys.executable).parent)) or shutil.which("uv")
    if found is None:
        pytest.skip("uv is not installed: make setup brings it")
    return found


@pytest.fixture(scope="module")
def wheel(uv, tmp_path_factory):
    """Built from the files that git knows, so that nothing of a working folder gets into it."""
    place = tmp_path_factory.mktemp("wheel")
    (place / "tree").mkdir()
    names = done("git", "ls-files", "-z", cwd=ROOT).split("\0")
    for name in filter(None, names):
        if (ROOT / name).is_file():
            (place / "tree" / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(ROOT / name, place / "tree" / name)
    done(uv, "build", "--wheel", "--out-dir", place, place / "tree")
    (made,) = place.glob("*.whl")
    return made


def python(version: str) -> str:
    """An interpreter of this version: this one, one on the PATH, or one installed beside this one."""
    if sys.version_info[:2] == tuple(map(int, version.split("."))):
        return sys.executable
    beside = sorted(Path(sys.base_prefix).parent.glob(f"{version}.*/bin/python{version}"))
    for candidate in (shutil.which(f"python{version}"), *map(str, beside)):
        if candidate and subprocess.run([candidate, "--version"], capture_output=True).returncode == 0:
            return candidate
    pytest.skip(f"no Python {version} here")


def test_the_version_is_said_in_one_place_and_the_changelog_knows_it(wheel):
    assert wheel.name.startswith(f"pido-{pido.__version__}-py3-none-any")
    assert f"## {pido.__version__}" in (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")


def test_the_wheel_holds_the_package_and_nothing_of_the_working_folder(wheel):
    names = zipfile.ZipFile(wheel).namelist()
    assert {"pido/py.typed", "pido/settings/machines.toml", "pido/reports/templates/page.html"} <= set(names)
    assert {name.split("/")[0] for name in names} == {"pido", "flows", f"pido-{pido.__version__}.dist-info"}
    assert not [name for name in names if "__pycache__" in name or name.endswith((".pyc", ".nbc", ".nbi"))]


@pytest.mark.slow
@pytest.mark.parametrize("version", ["3.11", "3.12", "3.13"])
def test_the_library_alone_works_in_a_fresh_environment(version, uv, wheel, tmp_path):
    home = tmp_path / "fresh"
    done(uv, "venv", "--python", python(version), home)
    done(uv, "pip", "install", "--python", home / "bin" / "python", wheel)
    said = done(home / "bin" / "python", "-c", USED, tmp_path / "p1", cwd=tmp_path)
    assert said.strip().endswith(pido.__version__)
    command = home / "bin" / "pido"
    assert "Verbs" in done(command, "--help")
    assert "p1" in done(command, "ingest", "p1", "--store", "store", cwd=tmp_path)
    assert "pido[servers]" in done(command, "watch", ".", "--prefect", "--once", "-w", "w", code=1, cwd=tmp_path)
