"""`make plant`: the plant's services as processes on this machine, watched over until you stop it.

In:  `deploy/plant.env` and a folder. Out: PostgreSQL, Prefect, MLflow, worker, watcher, each healthy before the next;
what dies is started again; Ctrl-C or SIGTERM stops all of it. `backup` and `restore` are one command each.
"""

from __future__ import annotations

import os
import shlex
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from types import FrameType

import click

from deploy import backup as backups
from deploy.services import Service, services
from deploy.settings import PlantSettings, load
from flows.server import ServerError, die_with_parent, free_port, stop
from pido.core.errors import PidoError

Running = dict[str, "subprocess.Popen[bytes]"]
SHELL = ("PIDO_WORKSPACE", "MLFLOW_TRACKING_URI", "MLFLOW_TRACKING_USERNAME")
STEADY_S = 600.0
"""A service that ran so long is started again at once when it dies, whatever was before, s."""


class Plant:
    """The processes of a plant. Use it as `with Plant(settings) as plant`."""

    def __init__(self, settings: PlantSettings, only: tuple[str, ...] = ()) -> None:
        self.settings = settings
        self.services = [s for s in services(settings) if not only or s.name in only]
        self.running: Running = {}
        self._failures: dict[str, int] = {}
        self._started: dict[str, float] = {}

    def __enter__(self) -> Plant:
        try:
            for service in self.services:
                self.start(service)
        except BaseException:
            self.stop()
            raise
        return self

    def __exit__(self, *error: object) -> None:
        self.stop()

    def start(self, service: Service, *, alone: bool = True) -> None:
        """Start and wait until healthy. Raises ServerError with the end of its log.

        alone : wait for this one whatever becomes of the others; else one that it may need is not kept waiting
        """
        log = self.settings.folder / "logs" / f"{service.name}.log"
        log.parent.mkdir(parents=True, exist_ok=True)
        for stale in self.settings.workspace.glob(f"{service.name}.alive"):
            stale.unlink()
        click.echo(f"starting {service.name}", err=True)
        with log.open("ab") as out:
            self.running[service.name] = subprocess.Popen(
                service.command, env={**_plain_environment(), **service.environment}, stdout=out, cwd=_root(service),
                stderr=subprocess.STDOUT, start_new_session=True, preexec_fn=die_with_parent, user=service.user,
            )  # fmt: skip
        self._started[service.name] = time.monotonic()
        process, deadline = self.running[service.name], time.monotonic() + service.patience_s
        while not service.healthy():
            if not alone and any(p.poll() is not None for p in self.running.values() if p is not process):
                return
            if process.poll() is not None or time.monotonic() > deadline:
                tail = log.read_text(encoding="utf-8", errors="replace")[-2000:]
                raise ServerError(f"{service.name} did not become healthy. The end of {log}:\n{tail}")
            time.sleep(0.2)

    def look_after(self) -> None:
        """Start again what has died. One that dies soon, again and again, is given more and more time."""
        for service in self.services:
            process = self.running.get(service.name)
            if process is None or process.poll() is None:
                continue
            if time.monotonic() - self._started[service.name] > STEADY_S:
                self._failures[service.name] = 0
            self._failures[service.name] = self._failures.get(service.name, 0) + 1
            click.echo(f"{service.name} ended with {process.returncode}; it is started again", err=True)
            stop(process)  # what it may have left behind
            time.sleep(min(2.0 ** (self._failures[service.name] - 1) - 1, 60.0))
            try:
                self.start(service, alone=False)
            except ServerError as error:
                click.echo(str(error), err=True)

    def stop(self) -> None:
        """All of them, the last one first."""
        for service in reversed(self.services):
            if service.name in self.running:
                stop(self.running.pop(service.name), patience_s=20.0)


def with_free_ports(settings: PlantSettings) -> PlantSettings:
    """The same settings, with a free port wherever the wanted one is taken."""
    changes = {}
    for name in ("postgres_port", "prefect_port", "mlflow_port"):
        wanted = getattr(settings, name)
        if not _free(wanted):
            changes[name] = free_port()
            click.echo(f"port {wanted} is taken; {name.removesuffix('_port')} listens on {changes[name]}", err=True)
    return replace(settings, **changes)


@click.group(invoke_without_command=True)
@click.option("--folder", type=click.Path(file_okay=False, path_type=Path), default=Path("plant"), show_default=True)
@click.pass_context
def main(ctx: click.Context, folder: Path) -> None:
    """Start the plant and watch over it until Ctrl-C.

    \b
    python -m deploy.plant --folder plant
    python -m deploy.plant --folder plant backup plant-2026-11-21.tar
    python -m deploy.plant --folder elsewhere restore plant-2026-11-21.tar
    """
    ctx.obj = folder
    if ctx.invoked_subcommand is None:
        _up(folder)


@main.command()
@click.argument("archive", type=click.Path(dir_okay=False, path_type=Path))
@click.pass_obj
def backup(folder: Path, archive: Path) -> None:
    """Everything of the plant into one file, while it runs or stands still."""
    settings = load(folder)
    with _database(settings) as reachable:
        backups.backup(reachable, archive)
    click.echo(f"{archive}: {archive.stat().st_size / 1e6:.1f} MB")


@main.command()
@click.argument("archive", type=click.Path(exists=True, dir_okay=False, path_type=Path))
@click.pass_obj
def restore(folder: Path, archive: Path) -> None:
    """Everything from a backup into a new, empty folder."""
    backups.unpack(archive, folder)
    settings = with_free_ports(load(folder))
    with Plant(settings, only=("postgres",)):
        backups.restore_databases(settings)
    click.echo(f"{folder}: restored; start it with --folder {folder}")


def _up(folder: Path) -> None:
    settings = with_free_ports(load(folder))

    def leave(number: int, frame: FrameType | None) -> None:
        raise KeyboardInterrupt

    signal.signal(signal.SIGTERM, leave)
    try:
        with Plant(settings) as plant:
            click.echo(f"Prefect   {settings.prefect_page}   (login {settings.prefect_user})")
            click.echo(f"MLflow    {settings.mlflow_page}   (login {settings.mlflow_user})")
            click.echo(f"inbox     {settings.workspace / 'inbox'}")
            kept = settings.folder / "secrets.env"
            click.echo(f"a shell   {shell(settings)}")
            click.echo(f"passwords {kept if kept.exists() else 'from the environment'}")
            sys.stdout.flush()
            while True:
                time.sleep(1.0)
                plant.look_after()
    except KeyboardInterrupt:
        click.echo("stopped", err=True)


def shell(settings: PlantSettings) -> str:
    """What points a shell at the plant: `pido status` and decisions then speak to its MLflow. No password is in it."""
    kept = settings.folder / "secrets.env"
    own = f"$(sed -n s/^PIDO_MLFLOW_PASSWORD=//p {shlex.quote(str(kept))})"
    values = [f"{name}={shlex.quote(settings.client_environment()[name])}" for name in SHELL]
    password = own if kept.exists() and not os.environ.get("PIDO_MLFLOW_PASSWORD") else "$PIDO_MLFLOW_PASSWORD"
    return f'export {" ".join(values)} MLFLOW_TRACKING_PASSWORD="{password}"'


@contextmanager
def _database(settings: PlantSettings) -> Iterator[PlantSettings]:
    """A PostgreSQL to dump from: the running one, or one that is started for it."""
    from deploy import postgres

    running = settings.folder / "postgres" / "postmaster.pid"
    lines = running.read_text(encoding="utf-8").splitlines() if running.exists() else []
    if len(lines) > 3 and _lives(int(lines[0])):  # line 1 is its process, line 4 the port that it listens on
        here = replace(settings, postgres_port=int(lines[3]))
        if postgres.ready(here):
            yield here
            return
    settings = with_free_ports(settings)
    with Plant(settings, only=("postgres",)):
        yield settings


def _lives(process: int) -> bool:
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except PermissionError:
        pass  # somebody else's
    return True


def _free(port: int) -> bool:
    import socket

    with socket.socket() as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind(("127.0.0.1", port))
        except OSError:
            return False
    return True


def _plain_environment() -> dict[str, str]:
    """The environment without what would send a service elsewhere; secrets go only to those that need them."""
    return {k: v for k, v in os.environ.items() if not k.startswith(("PREFECT_", "MLFLOW_", "PIDO_"))}


def _root(service: Service) -> str:
    return "/" if service.user else str(Path(__file__).parents[1])


if __name__ == "__main__":
    try:
        main()
    except PidoError as fault:
        click.echo(f"plant: {fault}", err=True)
        sys.exit(1)
