"""A local Prefect server of our own: started on a free loopback port, waited for, stopped with all that it started.

In:  a folder for its database and log.
Out: its address while the `with` block runs, also in `PREFECT_API_URL`; afterwards nothing of it is left running.

Prefect's own temporary server starts with every process, forgets, and is noisy at the end; so we start one.
"""

from __future__ import annotations

import ctypes
import os
import signal
import socket
import subprocess
import sys
import time
import urllib.error
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from pido.core.errors import PidoError

QUIET = {
    "DO_NOT_TRACK": "1",
    "PREFECT_SERVER_ANALYTICS_ENABLED": "false",
    "PREFECT_SERVER_UI_SHOW_PROMOTIONAL_CONTENT": "false",
    "PREFECT_LOGGING_SERVER_LEVEL": "WARNING",
    "PREFECT_CLI_WRAP_LINES": "false",
}


class ServerError(PidoError):
    """A server that did not start, or that went away."""


def free_port() -> int:
    """A loopback port that nobody listens on at the moment."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


def die_with_parent() -> None:
    """Run in a child before it starts: stop it when its parent dies, and let it be interrupted.

    A process started with `&` in a script inherits an ignored SIGINT, and Prefect would then not stop at one SIGTERM.
    """
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    if sys.platform == "linux":
        PR_SET_PDEATHSIG = 1
        ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGTERM)


def stop(process: subprocess.Popen[bytes], patience_s: float = 10.0) -> None:
    """End a process that was started in a session of its own, and everything that it started."""
    for kind in (signal.SIGTERM, signal.SIGKILL):
        try:
            os.killpg(process.pid, kind)
        except ProcessLookupError:
            break
        try:
            process.wait(patience_s)
        except subprocess.TimeoutExpired:
            continue
        if kind is signal.SIGTERM:
            time.sleep(0.2)  # children that were told the same get a moment before they are killed
    process.wait()


def answers(url: str, timeout_s: float = 2.0) -> bool:
    """Whether something healthy answers at `url`."""
    try:
        with urllib.request.urlopen(url, timeout=timeout_s) as reply:
            return reply.status == 200
    except (urllib.error.URLError, OSError):
        return False


@contextmanager
def prefect_server(home: Path, port: int | None = None, patience_s: float = 300.0) -> Iterator[str]:
    """The address of the API, e.g. http://127.0.0.1:4200/api. Raises ServerError with the end of its log."""
    home.mkdir(parents=True, exist_ok=True)
    port = port or free_port()
    api = f"http://127.0.0.1:{port}/api"
    own = {**os.environ, **QUIET, "PREFECT_HOME": str(home), "PREFECT_API_URL": api}
    log = home / "server.log"
    with log.open("ab") as out:
        process = subprocess.Popen(
            [sys.executable, "-m", "prefect", "server", "start", "--host", "127.0.0.1", "--port", str(port)],
            env=own, stdout=out, stderr=subprocess.STDOUT, start_new_session=True, preexec_fn=die_with_parent,
        )  # fmt: skip
    try:
        deadline = time.monotonic() + patience_s
        while not answers(f"{api}/health"):
            if process.poll() is not None or time.monotonic() > deadline:
                tail = log.read_text(encoding="utf-8", errors="replace")[-2000:]
                raise ServerError(f"the Prefect server did not start on port {port}. The end of {log}:\n{tail}")
            time.sleep(0.25)
        # The settings that Prefect read when it was imported name another server, where there was one before.
        from prefect.settings import PREFECT_API_URL, temporary_settings

        values = {"PREFECT_HOME": str(home), "PREFECT_API_URL": api}
        with environment(QUIET | values), temporary_settings({PREFECT_API_URL: api}):
            yield api
    finally:
        stop(process)


@contextmanager
def environment(values: dict[str, str]) -> Iterator[None]:
    """These variables while the block runs; afterwards what was there before."""
    before = {name: os.environ.get(name) for name in values}
    os.environ.update(values)
    try:
        yield
    finally:
        for name, value in before.items():
            os.environ.pop(name, None) if value is None else os.environ.__setitem__(name, value)
