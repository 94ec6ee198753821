"""Faults that one process can have: kills, a full disk, a clock that jumps, a store that cannot be written, torn parts.

In:  a few cheap part folders, how many faults of each kind, a seed. Out: an `Outcome` per kind.
"""

from __future__ import annotations

import os
import random
import resource
import shutil
import signal
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from datetime import datetime, timedelta
from pathlib import Path

from benchmarks.chaos_attempts import Outcome, ended, from_inbox, killed, silent, start_process, state, take, taken_in
from pido import parts, plain, production
from pido.approval import approve
from pido.arrivals import Inbox
from pido.core import clock
from pido.store import Store
from pido.tracking import promotion
from pido.tracking.ledger import Ledger
from pido.workspace import Workspace

SETTINGS = """compare = false
[method]
adaptive = false
compare_with_model = false
"""
NOBODY_THERE = "http://127.0.0.1:9"
LOG = production.log
NOBODY = 65534
"""User id of an attempt that may read the workspace but not write to it."""
YEAR_S = 3.15e7


class Storm:
    """Faults against workspaces below `root`; each kind has a workspace of its own."""

    def __init__(self, root: Path, folders: Sequence[Path], machine: str, seed: int) -> None:
        self.root, self.folders, self.machine = root, list(folders), machine
        self.rng = random.Random(seed)
        self._numbers = iter(range(10**6))
        warm = self.workspace()
        production.log = lambda root: {"logged": 0, "fault": ""}
        take(warm, self.folders[0])  # here, so that no attempt compiles anything
        shutil.rmtree(warm.root)
        start = time.monotonic()
        calm = self.workspace()
        for folder in self.folders:
            ended(start_process(lambda f=folder: take(calm, f), self.log()))
        self.seconds = (time.monotonic() - start) / len(self.folders)
        looked = self.workspace()
        start = time.monotonic()
        ended(start_process(lambda: parts.ingest(str(looked.root), str(self.folders[0])) and None, self.log()))
        self.ingest_s = time.monotonic() - start
        shutil.rmtree(looked.root)
        self.calm = state(calm, self.machine)
        if len(self.calm["parts"]) != len(self.folders):
            raise RuntimeError(f"the undisturbed run did not end well:\n{self.log().read_text()[-2000:]}")

    def workspace(self) -> Workspace:
        root = self.root / f"plant-{next(self._numbers)}"
        root.mkdir()
        (root / "workspace.toml").write_text(SETTINGS)
        return Workspace.open(root)

    def killed(self, count: int) -> Outcome:
        """kill -9 of an iteration at a random moment, again and again, until `count` kills hit."""
        return self._repeated("kill -9 of an iteration", count, self._one_kill)

    def disk_full(self, count: int) -> Outcome:
        """No file may grow beyond a random size while a part is taken from the inbox."""
        return self._repeated("disk full", count, self._one_full_disk)

    def clock(self, count: int) -> Outcome:
        """Whoever asks for the time gets another year at each question, and files arrive with times of any year; the
        attempt, a part from the inbox and a decision, is killed most of the time."""
        return self._repeated("clock jumps", count, self._one_jump)

    def read_only(self, count: int) -> Outcome:
        """The workspace cannot be written. As root the attempt becomes another user, else the folders lose their w."""
        return self._repeated("read-only store", count, self._one_read_only)

    def twice(self, count: int) -> Outcome:
        """The same part in two processes at the same moment."""
        return self._repeated("same part twice at once", count, self._two_at_once)

    def torn(self, count: int) -> Outcome:
        """A batch with a recording in its middle of which only the first bytes came."""
        return self._repeated("half copied, in a batch", count, self._one_torn, refuses=True)

    def replaced(self, count: int) -> Outcome:
        """A part's folder gets the files of another part and its own again, over and over, while it is read."""
        return self._repeated("replaced while read", count, self._one_replaced)

    def mlflow_away(self, count: int) -> Outcome:
        """MLflow's server does not answer; later it does again, and gets what it has missed."""
        return self._repeated("MLflow away", count, self._one_without_mlflow)

    def heap(self, count: int) -> Outcome:
        """`count` arrivals at once: the parts again and again under other names, and torn ones among them."""
        place = self.workspace()
        inbox = place.inbox
        torn = 0
        for number in range(count):
            folder = self.folders[number % len(self.folders)]
            copy = inbox / f"{folder.name}-{number:03d}"
            shutil.copytree(folder, copy)
            if number % 10 == 9:
                recording = copy / "recording.parquet"
                whole = recording.read_bytes()
                recording.write_bytes(whole[: self.rng.randrange(len(whole))])
                torn += 1

        def attempt() -> None:
            arrived = sorted(inbox.iterdir())
            plain.run(place, arrived, None, silent, from_inbox=True)

        ended(start_process(attempt, self.log()))
        found = state(place, self.machine)
        rejected = len({a.name for a in Ledger(place.ledger).rejections()})
        lost = len(set(self.calm["parts"]) - set(found["parts"])) + torn - rejected + len(list(inbox.iterdir()))
        same = found == self.calm
        shutil.rmtree(place.root)
        doubled = len(found["parts"]) - len(set(found["parts"]))
        return Outcome(f"{count} arrivals at once", 1, rejected, lost, doubled, same)

    def promotions(self, count: int) -> Outcome:
        """kill -9 during approvals and rollbacks, on the versions that the parts brought."""
        place = self._finished()
        found = promotions(place, self.machine, count, self.rng, self.log())
        return replace(found, same=found.same and state(place, self.machine) == self.calm)

    def _finished(self) -> Workspace:
        place = self.workspace()
        for folder in self.folders:
            ended(start_process(lambda f=folder: take(place, f), self.log()))
        return place

    def _repeated(
        self, kind: str, count: int, fault: Callable[[Workspace, Path], tuple[int, int]], refuses: bool = False
    ) -> Outcome:
        """Faults spread over the parts in a random order; each part is brought again without a fault at the end.

        refuses : parts are at fault and belong into the rejected area; else one that is found there counts as lost
        """
        faults = cut = 0
        lost = doubled = 0
        same = True
        while faults < count:
            place = self.workspace()
            order = self.rng.sample(self.folders, len(self.folders))
            for number, folder in enumerate(order):
                share = max(1, (count - faults) // (len(order) - number)) if faults < count else 0
                for _ in range(min(share, 12)):
                    caused, failed = fault(place, folder)
                    faults, cut = faults + caused, cut + failed
                if not ended(start_process(lambda f=folder, p=place: take(p, f), self.log())):
                    same = False
            found = state(place, self.machine)
            lost += len(set(self.calm["parts"]) - set(found["parts"]))
            lost += 0 if refuses else len(Ledger(place.ledger).rejections())
            doubled += len(found["parts"]) - len(set(found["parts"]))
            same &= found == self.calm
            shutil.rmtree(place.root)
        return Outcome(kind, faults, cut, lost, doubled, same)

    def _one_kill(self, place: Workspace, folder: Path) -> tuple[int, int]:
        process = start_process(lambda: take(place, folder), self.log())
        time.sleep(self.rng.uniform(0, self.seconds))
        hit = killed(process)
        return hit, hit

    def _one_full_disk(self, place: Workspace, folder: Path) -> tuple[int, int]:
        limit = int(10 ** self.rng.uniform(2, 5.5))
        arrived = _delivered(place, folder)

        def attempt() -> None:
            signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
            resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))
            from_inbox(place, arrived)

        return 1, not ended(start_process(attempt, self.log()))

    def _one_jump(self, place: Workspace, folder: Path) -> tuple[int, int]:
        arrived = _delivered(place, folder)
        for file in arrived.iterdir():
            then = time.time() + self.rng.uniform(-30, 30) * YEAR_S
            os.utime(file, (then, then))
        seed = self.rng.random()

        def attempt() -> None:
            with clock_that_jumps(random.Random(seed)):
                inbox, whole = Inbox(place.inbox, 0.02), []
                while not whole:
                    whole, _ = inbox.look()
                for one in whole:
                    from_inbox(place, one.path)
                _decide(place, self.machine)

        process = start_process(attempt, self.log())
        if self.rng.random() < 0.7:
            time.sleep(self.rng.uniform(0, self.seconds))
            return 1, killed(process)
        return 1, not ended(process)

    def _one_read_only(self, place: Workspace, folder: Path) -> tuple[int, int]:
        as_root = os.geteuid() == 0
        folders = [place.root, *(p for p in place.root.rglob("*") if p.is_dir())]
        for one in folders:
            one.chmod(0o555)

        def attempt() -> None:
            if as_root:
                os.setuid(NOBODY)
            take(place, folder)

        try:
            return 1, not ended(start_process(attempt, self.log()))
        finally:
            for one in folders:
                one.chmod(0o755)

    def _two_at_once(self, place: Workspace, folder: Path) -> tuple[int, int]:
        both = [start_process(lambda: take(place, folder), self.log()) for _ in range(2)]
        return 1, sum(not ended(process) for process in both)

    def _one_torn(self, place: Workspace, folder: Path) -> tuple[int, int]:
        torn = self.root / "arriving" / folder.name
        shutil.rmtree(torn, ignore_errors=True)
        shutil.copytree(folder, torn)
        recording = torn / "recording.parquet"
        whole = recording.read_bytes()
        recording.write_bytes(whole[: self.rng.randrange(len(whole))])
        known = [f for f in self.folders if Store(place.store).entries()][:1]
        batch = [*known, torn]
        ended(start_process(lambda: plain.run(place, batch, None, silent) and None, self.log()))
        rejected = any(a.name == torn.name for a in Ledger(place.ledger).rejections())
        return 1, int(rejected)

    def _one_replaced(self, place: Workspace, folder: Path) -> tuple[int, int]:
        arriving = self.root / "arriving" / folder.name
        shutil.rmtree(arriving, ignore_errors=True)
        shutil.copytree(folder, arriving)
        other = self.rng.choice([f for f in self.folders if f != folder])
        done = threading.Event()
        pauses = [self.rng.uniform(0, self.ingest_s) for _ in range(100)]

        def swap() -> None:
            for number, pause in enumerate(pauses):
                if done.wait(pause):
                    break
                _replace(arriving, (other, folder)[number % 2])

        process = start_process(lambda: taken_in(place, arriving), self.log())
        swapper = threading.Thread(target=swap)
        swapper.start()
        well = ended(process)
        done.set()
        swapper.join()
        return 1, int(not well)

    def _one_without_mlflow(self, place: Workspace, folder: Path) -> tuple[int, int]:
        def attempt(uri: str | None) -> None:
            os.environ.update(MLFLOW_HTTP_REQUEST_MAX_RETRIES="0", MLFLOW_HTTP_REQUEST_TIMEOUT="1")
            production.log = LOG
            if uri:
                os.environ["MLFLOW_TRACKING_URI"] = uri
            take(place, folder)

        away = ended(start_process(lambda: attempt(NOBODY_THERE), self.log()))
        waiting = bool(Ledger(place.ledger).not_logged(place.tracking_place))
        back = ended(start_process(lambda: attempt(None), self.log()))
        if Ledger(place.ledger).not_logged(place.tracking_place):
            raise RuntimeError(f"MLflow is back and has not got every iteration:\n{self.log().read_text()[-2000:]}")
        return 1, int(waiting or not (away and back))

    def log(self) -> Path:
        return self.root / "attempts.log"


def promotions(place: Workspace, machine: str, count: int, rng: random.Random, log: Path) -> Outcome:
    """kill -9 during approvals and rollbacks: the old or the new version is in force, whole, and on record once.

    Lost: decisions in force that the history does not have. Doubled: records that it has twice.
    """
    versions = [v.version for v in Ledger(place.ledger).versions(machine) if v.gate.get("passed")]
    if not versions:
        raise RuntimeError("no version passed its gate: nothing to promote")

    def swap() -> None:
        now = promotion.champion(place, machine)
        if now is not None and now.version == versions[-1] and len(versions) > 1:
            promotion.rollback(place, machine, by="chaos", reason="back")
        else:
            approve(place, machine, versions[-1], by="chaos", reason="forth")

    approve(place, machine, versions[0], by="chaos", reason="before the faults")
    start = time.monotonic()
    if not ended(start_process(swap, log)):
        raise RuntimeError(f"a promotion without a fault did not end well:\n{log.read_text()[-2000:]}")
    seconds = time.monotonic() - start
    hits = lost = doubled = 0
    whole = True
    while hits < count:
        process = start_process(swap, log)
        time.sleep(rng.uniform(0, 1.2 * seconds))
        hits += killed(process)
        bundle_in_force, record = promotion.champion_bundle(place, machine), promotion.champion(place, machine)
        history = promotion.history(place, machine)
        whole &= bundle_in_force is not None and record is not None and record.version in versions
        lost += record not in history
        doubled += len(history) - len({r.hash for r in history})
    whole &= ended(start_process(swap, log))  # the next decision needs no hand work
    return Outcome("kill -9 of a promotion", hits, hits, lost, doubled, whole)


def _delivered(place: Workspace, folder: Path) -> Path:
    """A copy of the part in the inbox; one that is there still stays as it is."""
    arrived = place.inbox / folder.name
    if not arrived.exists():
        shutil.copytree(folder, arrived)
    return arrived


def _replace(folder: Path, by: Path) -> None:
    """File by file, each by rename."""
    new = [(shutil.copy2(file, folder.parent / f"{by.name}-{file.name}"), folder / file.name) for file in by.iterdir()]
    for source, target in new:
        Path(source).replace(target)


def _decide(place: Workspace, machine: str) -> None:
    """Back to the champion before, or forth to the newest version that may be promoted, if there is any."""
    passed = [v.version for v in Ledger(place.ledger).versions(machine) if v.gate.get("passed")]
    now = promotion.champion(place, machine)
    if now is not None and len({r.version for r in promotion.history(place, machine)}) > 1:
        promotion.rollback(place, machine, by="chaos", reason="back")
    elif passed:
        approve(place, machine, passed[-1], by="chaos", reason="forth")


@contextmanager
def clock_that_jumps(rng: random.Random) -> Iterator[None]:
    """Every question for the time of day is answered with another year."""

    class Jumping(datetime):
        @classmethod
        def now(cls, tz=None):
            return datetime.now(tz) + timedelta(days=rng.uniform(-10_000, 10_000))

    real, real_ns, named = time.time, time.time_ns, clock.datetime
    time.time = lambda: real() + rng.uniform(-30, 30) * YEAR_S
    time.time_ns = lambda: real_ns() + int(rng.uniform(-30, 30) * YEAR_S * 1e9)
    clock.datetime = Jumping
    try:
        yield
    finally:
        time.time, time.time_ns, clock.datetime = real, real_ns, named
