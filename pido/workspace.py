"""A workspace: one folder with everything that production writes, and the settings it runs under.

In:  a folder; `workspace.toml` in it, where a person has written one.
Out: the places of store, ledger, bundles, registry and locks, and the key under which a result is known:
     the digest of what decides it (parts, method settings, seed, code).

    plant/
      workspace.toml   settings (optional)
      inbox/           where parts arrive                taken/      what arrived and was taken in
      store/           recordings, append-only; in rejected/ what cannot be used, each with its reason
      derived/         the samples made from them and work/, an iteration on its way (both can be deleted)
      ledger.db        what was done with each part      runs/       what each iteration found, by run key
      bundles/         models + equation + limits        registry/   champion per machine, audit log
      mlflow.db        MLflow, unless a server is named  locks/      one lock per machine
      monitor/         verdicts, alarms and the answers to them, per machine
      diagnosis/       what the simulation of the newest parts left out, per machine (can be deleted)
      backlog/         what in an inbox could not be done yet
      workspace.id     which it is, on a Prefect or MLflow server that several share
      mlflow.json      where iterations were last logged
"""

from __future__ import annotations

import fcntl
import hashlib
import json
import os
import secrets
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from importlib.resources import files
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ConfigDict, Field, NonNegativeInt, PositiveFloat, PositiveInt, field_validator

from pido import __version__
from pido.config import MethodSettings, load_job, parse, read_toml
from pido.core.errors import SettingsError, StoreError, UnavailableError
from pido.core.files import write_atomically
from pido.core.machining import Job, MeshStock
from pido.core.names import file_name
from pido.monitoring import records

_METHOD = ("core", "physics", "process", "recordings", "feature_space", "equations", "sampling", "models")
MLFLOW_PAGE = "PIDO_MLFLOW_PAGE"
"""Beside MLFLOW_TRACKING_URI, by which the worker calls MLflow: how browsers do."""


class WorkspaceSettings(BaseModel):
    """The content of `workspace.toml`; unknown keys are refused by name."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    machine: str | None = Field(default=None, description="machine of recordings that do not name theirs")
    jobs: dict[str, Path] = Field(
        default_factory=dict, description="per machine, the job file (material, tools, stock) of parts that name none"
    )
    machines_file: Path | None = Field(default=None, description="TOML with further machines")
    materials_file: Path | None = Field(default=None, description="TOML with further materials")
    method: MethodSettings = Field(default_factory=MethodSettings, description="a table, or 'paper': as printed")
    seed: NonNegativeInt = Field(default=0, description="of everything that draws at random")
    rate_hz: PositiveFloat = Field(default=50.0, description="samples per second that the method works on, 1/s")
    air_cut: bool = Field(default=False, description="parts without process quantities were cut in air: no forces")
    compare: bool = Field(default=True, description="train real-only, +PiA and +PiE beside +both, to compare")
    gate_parts: PositiveInt = Field(default=5, description="most recent parts on which the gate compares")
    tracking_uri: str | None = Field(default=None, description="MLflow server; none: mlflow.db in the workspace")
    tracking_page: str | None = Field(
        default=None, pattern="^https?://", description="MLflow's pages as browsers call them; none: tracking_uri"
    )
    approval_token_sha256: str | None = Field(
        default=None, pattern="^[0-9a-f]{64}$", description="SHA-256 of the token that approval asks for"
    )
    settle_s: PositiveFloat = Field(default=2.0, description="an arriving file must stay unchanged this long, s")
    scan_s: PositiveFloat = Field(default=30.0, description="the inbox is looked through at least this often, s")

    @field_validator("method", mode="before")
    @classmethod
    def _by_name(cls, value: Any) -> Any:
        return MethodSettings.paper() if value == "paper" else value


@dataclass(frozen=True, slots=True)
class Workspace:
    """planned : by machine, what is not learnt from, where that was fixed before (`excluding`)"""

    root: Path
    settings: WorkspaceSettings
    planned: dict[str, records.Stretches] = field(default_factory=dict)

    @classmethod
    def open(cls, root: Path | str, **changes: Any) -> Workspace:
        """The workspace at `root`, made if it is not there. `changes` go over the settings of its file.

        Raises SettingsError for a fault in `workspace.toml`, StoreError where the folder cannot be made.
        """
        root = Path(root).absolute()
        try:
            root.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise StoreError(f"{root}: no workspace can be made here ({error.strerror}); choose another.") from None
        file = root / "workspace.toml"
        content = {**(read_toml(file) if file.exists() else {}), **{k: v for k, v in changes.items() if v is not None}}
        return cls(root, parse(WorkspaceSettings, content, str(file)))

    @classmethod
    def make(cls, root: Path | str, job: Path | None = None, **wanted: Any) -> Workspace:
        """The workspace at `root` under the settings `wanted`, which are written into it when it is new.

        job : a job file; it holds for all parts of the machine that it names
        One workspace has one set of settings: SettingsError where it is there already and says otherwise.
        """
        root = Path(root).absolute()
        given = {name: value for name, value in wanted.items() if value is not None}
        if job is not None:
            machine = load_job(job).machine.id
            given |= {"machine": given.get("machine", machine), "jobs": {machine: job.absolute()}}
        file = root / "workspace.toml"
        if file.exists() or (root / "ledger.db").exists():
            here = cls.open(root)
            for name, value in given.items():
                says = getattr(here.settings, name)
                if name == "jobs":
                    says = {machine: root / path for machine, path in says.items() if machine in value}
                if says != value:
                    raise SettingsError(
                        f"{file}: {name} is {says!r} in this workspace, not {value!r}. Change it there, for all its "
                        "parts, or use another workspace."
                    )
            return here
        if given:
            parse(WorkspaceSettings, given, str(root))
            jobs = given.pop("jobs", {})
            lines = [f"{name} = {json.dumps(value)}" for name, value in given.items()]
            lines += ["[jobs]", *(f"{json.dumps(m)} = {json.dumps(str(p))}" for m, p in jobs.items())] if jobs else []
            write_atomically(file, "\n".join(lines) + "\n")
        return cls.open(root)

    @property
    def id(self) -> str:
        """Eight hexadecimal digits, drawn once and kept in the folder: it is known by them wherever it is moved to."""
        path = self.root / "workspace.id"
        if not path.exists():
            with self.lock("workspace.id"):
                if not path.exists():
                    write_atomically(path, secrets.token_hex(4) + "\n")
        return path.read_text(encoding="utf-8").strip()

    @property
    def inbox(self) -> Path:
        return self.root / "inbox"

    @property
    def store(self) -> Path:
        return self.root / "store"

    @property
    def derived(self) -> Path:
        return self.root / "derived"

    @property
    def work(self) -> Path:
        return self.root / "work"

    @property
    def taken(self) -> Path:
        return self.root / "taken"

    @property
    def runs(self) -> Path:
        return self.root / "runs"

    @property
    def bundles(self) -> Path:
        return self.root / "bundles"

    @property
    def registry(self) -> Path:
        return self.root / "registry"

    @property
    def monitor(self) -> Path:
        return self.root / "monitor"

    def diagnosis(self, machine: str) -> Path:
        """Where the newest parts' diagnosis lies; the next one takes its place."""
        return self.root / "diagnosis" / file_name(machine)

    @property
    def ledger(self) -> Path:
        return self.root / "ledger.db"

    @property
    def tracking_uri(self) -> str:
        """Of MLflow: the settings' server, else the one in the environment, else a SQLite file in the workspace."""
        named = self.settings.tracking_uri or os.environ.get("MLFLOW_TRACKING_URI")
        return named or self._own_tracking

    @property
    def tracking_page(self) -> str:
        """MLflow's pages as people's browsers call them, '' where there are none: named beside the server, in the
        settings or in the environment, else the server's own address, without a password that it may hold."""
        s, uri = self.settings, self.tracking_uri
        named = s.tracking_page or (None if s.tracking_uri else os.environ.get(MLFLOW_PAGE))
        if not named and uri.startswith("http"):
            named = without_secrets(uri)
        return (named or "").rstrip("/")

    @property
    def _own_tracking(self) -> str:
        return f"sqlite:///{self.root / 'mlflow.db'}"

    @property
    def tracks_alone(self) -> bool:
        """Whether MLflow is the file in the workspace, which is no other workspace's and goes where it goes."""
        return self.tracking_uri == self._own_tracking

    @property
    def tracking_place(self) -> str:
        """MLflow's address and whose names are used there, as a digest: an address may hold a password. That of the
        workspace's own file does not change when the workspace is moved."""
        return "own" if self.tracks_alone else digest_of([self.tracking_uri, self.id])[:16]

    def job(self, machine: str) -> Job | None:
        """What is cut with what on `machine` where a part does not say it itself, or None."""
        file = self.settings.jobs.get(machine)
        return None if file is None else load_job(self.root / file)

    def settings_digest(self, machine: str) -> str:
        """Of the settings that decide training sets and models of `machine`: method, rates, job, materials."""
        s = self.settings
        own = [s.machines_file, s.materials_file]
        job = self.job(machine)
        if job is not None and isinstance(job.stock, MeshStock):
            own.append(Path(job.stock.path))
        return digest_of(
            {
                "method": s.method.model_dump(mode="json"),
                "rate_hz": s.rate_hz,
                "air_cut": s.air_cut,
                "job": repr(job),
                "files": [hashlib.sha256((self.root / f).read_bytes()).hexdigest() if f else None for f in own],
            }
        )

    def run_key(self, machine: str, parts: list[str]) -> str:
        """What an iteration over the *set* `parts` (digests) is known by: parts, settings, seed, code, and what of them
        people said not to learn from."""
        excluded = {
            part: where for part, where in self.excluded(machine).items() if part in parts or records.name_in(part)
        }
        return digest_of(
            {
                "machine": machine,
                "parts": sorted(set(parts)),
                "settings": self.settings_digest(machine),
                "seed": self.settings.seed,
                "code": code_version(),
                **({"excluded": excluded} if excluded else {}),
                **({"physics": physics} if (physics := self.physics_digest(machine)) else {}),
            }
        )

    def book(self, machine: str) -> Path:
        """The file that `pido.supervision.book` keeps."""
        return self.monitor / file_name(machine) / "book.jsonl"

    def excluded(self, machine: str) -> records.Stretches:
        """Part digest (or what stands for it where it was followed, `monitoring.records.name_in`) -> stretches
        [start, end], s, of alarms that were answered as true: not to be learnt from."""
        if machine in self.planned:
            return self.planned[machine]
        found = records.excluded(self.book(machine))
        if not found:
            return found
        from pido.store import Store

        now, stretches = Store(self.store).today(found), records.Stretches()
        for part, where in found.items():  # of a part that columns were added to since: of what it is now
            stretches.setdefault(now[part], []).extend(where)
        return {part: sorted(where) for part, where in stretches.items()}

    def excluding(self, machine: str, excluded: records.Stretches) -> Workspace:
        """The same workspace, in which an answer that comes later changes nothing of what is learnt from."""
        return replace(self, planned={**self.planned, machine: excluded})

    def decisions(self, machine: str) -> Path:
        """The file that `pido.tracking.audit` keeps."""
        return self.registry / file_name(machine) / "audit.jsonl"

    def physics_journal(self, machine: str) -> Path:
        """The file that `pido.physics_journal` keeps."""
        return self.registry / f"{file_name(machine)}-physics.jsonl"

    def physics_digest(self, machine: str) -> str:
        """Of the accepted physics of a machine (`pido.accepted`), '' where none is in force."""
        journal = self.physics_journal(machine)
        if not journal.exists():
            return ""
        entries = map(json.loads, journal.read_text(encoding="utf-8").splitlines())
        last = {entry["id"]: entry for entry in entries if entry["action"] in ("accept", "revoke")}
        now = [entry["term"] for entry in last.values() if entry["action"] == "accept"]
        return digest_of(now) if now else ""

    def locked(self, name: str) -> bool:
        """Whether a living process holds the lock `name`."""
        try:
            with self.lock(name, timeout_s=0.0):
                return False
        except UnavailableError:
            return True

    def forget(self, name: str) -> None:
        """Remove the file of a lock that nobody will take again; its holder calls this."""
        (self.root / "locks" / f"{file_name(name)}.lock").unlink(missing_ok=True)

    @contextmanager
    def lock(self, machine: str, timeout_s: float | None = None) -> Iterator[None]:
        """One writer per machine at a time. The kernel frees it when its holder dies, however it dies.

        Raises UnavailableError after `timeout_s`; None waits as long as it takes.
        """
        path = self.root / "locks" / f"{file_name(machine)}.lock"
        path.parent.mkdir(parents=True, exist_ok=True)
        deadline = None if timeout_s is None else time.monotonic() + timeout_s
        with path.open("a+") as handle:
            while True:
                try:
                    fcntl.flock(handle, fcntl.LOCK_EX | (0 if deadline is None else fcntl.LOCK_NB))
                    break
                except BlockingIOError:
                    if deadline is not None and time.monotonic() >= deadline:
                        raise UnavailableError(
                            f"{self.root}: machine '{machine}' is in use by another run for over {timeout_s:g} s. "
                            "Wait for it, or look what holds it (`pido status`)."
                        ) from None
                    time.sleep(0.05)
            yield


def without_secrets(uri: str) -> str:
    """An address without the user, password and options that it may hold.

    >>> without_secrets("http://ann:secret@plant:5000"), without_secrets("postgresql://ann:p@db/mlflow?sslpassword=q")
    ('http://plant:5000', 'postgresql://db/mlflow')
    """
    scheme, slashes, rest = uri.partition("://")
    host, slash, path = rest.partition("?")[0].partition("/")
    return scheme + slashes + host.rpartition("@")[2] + slash + path


def code_version() -> str:
    """Version of the package and a digest of the code that decides results, as it was when this process began: that is
    what runs, also in forks of it, whatever is installed meanwhile."""
    return _CODE


def _code() -> str:
    package = files("pido")
    sources = hashlib.sha256()
    for folder in _METHOD:
        for name, text in _sources(Path(str(package)) / folder):
            sources.update(name.encode() + b"\0" + text + b"\0")
    sources.update(Path(str(package / "iteration.py")).read_bytes())
    return f"{__version__}+{sources.hexdigest()[:12]}"


def _sources(folder: Path) -> Iterator[tuple[str, bytes]]:
    for path in sorted(folder.rglob("*.py")):
        yield str(path.relative_to(folder)), path.read_bytes()


_CODE = _code()


def digest_of(content: Any) -> str:
    """SHA-256 of `content` as canonical JSON."""
    return hashlib.sha256(json.dumps(content, sort_keys=True, separators=(",", ":"), default=str).encode()).hexdigest()


def arrival_digest(path: Path) -> str:
    """SHA-256 of the bytes of a file, or of all files of a folder with their names: what arrived, before it is read.

    Raises StoreError for what is neither, and for symbolic links: a link could lead anywhere.
    """
    if path.is_symlink():
        raise StoreError(f"{path}: a symbolic link; only files and folders are taken. Copy what it points at.")
    if path.is_file():
        with path.open("rb") as handle:
            return hashlib.file_digest(handle, "sha256").hexdigest()
    if not path.is_dir():
        raise StoreError(f"{path}: no such file or folder.")
    total = hashlib.sha256()
    for file in sorted(path.rglob("*")):
        if file.is_symlink():
            raise StoreError(f"{file}: a symbolic link inside a part's folder; copy what it points at.")
        if file.is_file():
            total.update(f"{file.relative_to(path)}\0{arrival_digest(file)}\n".encode("utf-8", "surrogateescape"))
    return total.hexdigest()
