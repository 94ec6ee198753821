"""What containers run into, tried without them: a file system that is read-only, folders that a volume takes over."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import httpx
import pytest
import yaml
from served_worker import waited

from flows.server import answers, free_port, stop

pytestmark = pytest.mark.servers
ROOT = Path(__file__).parents[2]
SERVICES = yaml.safe_load((ROOT / "docker-compose.yml").read_text())["services"]
USER = "10001"
WITHOUT_WRITING = """
mount -o remount,bind,ro / && mount -t tmpfs tmpfs /tmp || exit 125
for pages in "$0"/ui_build "$0"/ui_v2_build; do [ ! -d "$pages" ] || mount -t tmpfs -o ro tmpfs "$pages"; done
exec "$@"
"""
"""As in the container: nothing but /tmp can be written, and no server has been there before."""


@pytest.mark.skipif(not shutil.which("unshare"), reason="needs util-linux")
def test_prefects_pages_are_there_where_nothing_but_tmp_can_be_written():
    assert SERVICES["prefect"]["read_only"]
    assert SERVICES["prefect"]["tmpfs"] == ["/tmp"]
    port = str(free_port())
    apart = ["unshare", "--mount", "--map-root-user", "sh", "-c", WITHOUT_WRITING, str(_prefect() / "server")]
    if subprocess.run([*apart, sys.executable, "-c", "import prefect"], capture_output=True, check=False).returncode:
        pytest.skip("mounting is not allowed here, or Python lies in /tmp")
    ours = {name: _value(text) for name, text in SERVICES["prefect"]["environment"].items()}
    ours["PREFECT_SERVER_DATABASE_CONNECTION_URL"] = "sqlite+aiosqlite:////tmp/prefect.db"
    command = [sys.executable, "-m", "prefect", "server", "start", "--host", "127.0.0.1", "--port", port]
    root = f"http://127.0.0.1:{port}"
    server = subprocess.Popen([*apart, *command], env=ours, start_new_session=True, stdout=subprocess.DEVNULL)
    try:
        waited(lambda: answers(f"{root}/api/health"), 120)
        page = httpx.get(root, headers={"Accept": "text/html"}, follow_redirects=True, timeout=60, trust_env=False)
    finally:
        stop(server)
    assert page.status_code == 200
    assert "Prefect" in page.text


@pytest.fixture
def installed(tmp_path) -> Path:
    """The root of an image in which the Dockerfile's folders were made."""
    command = re.search(r"install (--directory [^\n]+)", (ROOT / "deploy" / "Dockerfile").read_text())
    assert command
    words = command[1].replace("pido", USER).split()
    try:
        subprocess.run(["install", *(str(tmp_path) + w if w.startswith("/") else w for w in words)], check=True)
    except subprocess.CalledProcessError:
        pytest.skip("only root may give folders away")
    return tmp_path


def test_the_containers_user_owns_every_folder_that_a_volume_covers_and_the_inbox(installed):
    places = [v.split(":")[1] for s in SERVICES.values() if s["user"] == f"{USER}:{USER}" for v in s.get("volumes", [])]
    assert set(places) == {"/data/workspace", "/data/mlartifacts"}
    for place in (*places, "/data/workspace/inbox"):
        assert (installed / place.lstrip("/")).stat().st_uid == int(USER), place


def _prefect() -> Path:
    found = find_spec("prefect")
    assert found is not None
    assert found.origin is not None
    return Path(found.origin).parent


def _value(text: str) -> str:
    """What compose makes of it: the default where there is one, else a word of ours."""
    while "${" in text:  # the innermost first
        text = re.sub(r"\$\{\w+:?-?(\??[^${}]*)\}", lambda m: "ours" if m[1][:1] in ("?", "") else m[1], text)
    return text
