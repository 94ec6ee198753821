"""kill -9 of a plant's services while parts arrive and versions are promoted: real processes, as `make plant` has them.

In:  a workspace with a few parts and approved versions, part folders that are still to come, kills per victim, a seed.
Out: per victim two outcomes, one of its kills during iterations and one of those during promotions, and one for runs
     that say Running while they have no process, two minutes after the last kill.

Nobody helps: the plant starts again what died, and what was asked for is done in the end. After each part and each
decision store, registry and models are those of a workspace in which the same was done without servers and faults;
MLflow has every iteration once; and each kill has its line in the plant's log.
"""

from __future__ import annotations

import os
import random
import re
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from benchmarks.chaos_attempts import Outcome, state
from deploy.settings import PlantSettings, load
from flows.server import answers, environment, free_port
from pido.tracking import mirror, promotion
from pido.tracking.ledger import Ledger
from pido.workspace import Workspace

FORKS = "what runs are forked from"
VICTIMS = {
    "PostgreSQL": "postgres -D",
    "Prefect server": "prefect server",
    "MLflow server": "mlflow server",
    "worker": "flows.serve",
    "watcher": "pido.cli watch",
    FORKS: "multiprocessing.forkserver",
    "run of a part": "multiprocessing.forkserver",
}
"""How the process of each is told from the others by its command line; a run is a fork of what runs are forked from."""
PATIENCE_S = 1500.0
"""Of a busy machine; a plant that is well takes a small part of it, s."""
ZOMBIE_S = 120.0


class Plant:
    """A plant as `make plant` starts it, in a process of its own. Use it in a `with` block."""

    def __init__(self, folder: Path, log: Path) -> None:
        self.folder, self.log = folder, log
        ports = {f"PIDO_{name}_PORT": str(free_port()) for name in ("POSTGRES", "PREFECT", "MLFLOW")}
        self._ports = ports
        with environment(ports):
            self.settings: PlantSettings = load(folder)
        self.workspace = Workspace.open(self.settings.workspace)

    def __enter__(self) -> Plant:
        with self.log.open("ab") as out:
            self._process = subprocess.Popen(
                [sys.executable, "-m", "deploy.plant", "--folder", str(self.folder)],
                env={**os.environ, **self._ports}, stdout=out, stderr=out, cwd=Path(__file__).parents[1],
            )  # fmt: skip
        try:
            until(lambda: "passwords" in self.words(), "the plant does not come up", self._alive)
        except BaseException:
            self.stop()
            raise
        return self

    def __exit__(self, *error: object) -> None:
        self.stop()

    def stop(self) -> None:
        """As Ctrl-C does; a second time does nothing."""
        if self._process.poll() is None:
            self._process.terminate()
            self._process.wait(120)

    def words(self) -> str:
        """What the plant has said so far."""
        return self.log.read_text(encoding="utf-8", errors="replace")

    def process_of(self, victim: str) -> int | None:
        """Its process id, None while it has none."""
        seen = dict(processes())
        for process, command in seen.items():
            forked = VICTIMS["run of a part"] in seen.get(_parent(process), "")
            named = VICTIMS[victim] in command and forked == (victim == "run of a part")
            if named and _is_below(process, self._process.pid):
                return process
        return None

    def left(self) -> list[str]:
        """Command lines of processes that belong to this folder."""
        return [command for _, command in processes(str(self.folder))]

    def well(self) -> bool:
        """Whether all services answer or show signs of life."""
        servers = answers(f"{self.settings.prefect_api}/health") and answers(f"{self.settings.mlflow_uri}/health")
        return servers and all(self.process_of(victim) for victim in list(VICTIMS)[:5])

    def drop(self, folder: Path) -> None:
        """A part arrives, by rename."""
        staging = self.workspace.root / "staging" / folder.name
        shutil.copytree(folder, staging)
        staging.rename(self.workspace.inbox / folder.name)

    def decide(self, *decision: str) -> subprocess.Popen[bytes]:
        """`pido approve 4` or `pido rollback`, under way."""
        call = [sys.executable, "-m", "pido.cli", *decision, "--by", "chaos", "--reason", "kills",
                "--workspace", str(self.workspace.root)]  # fmt: skip
        with self.log.open("ab") as out:
            return subprocess.Popen(call, env=os.environ | self.settings.client_environment(), stdout=out, stderr=out)

    @contextmanager
    def as_client(self) -> Iterator[None]:
        """Addresses and logins of the plant in this process' environment."""
        with environment(self.settings.client_environment()):
            yield

    def _alive(self) -> None:
        if self._process.poll() is not None:
            raise RuntimeError(f"the plant has ended:\n{self.words()[-3000:]}")


def victims_of(
    plant: Plant, machine: str, coming: list[Path], reference: Callable[[Path | tuple[str, ...]], dict[str, Any]],
    kills: int, rng: random.Random, say: Callable[[str], None],
) -> list[Outcome]:  # fmt: skip
    """Kill each victim `kills` times while a part is on its way, and as often while decisions are.

    coming : a part for the undisturbed start, then one per victim
    reference : does the same - a part, or a decision - without servers and faults, and tells the state afterwards
    """
    found: list[Outcome] = []
    until(lambda: mirror.up_to_date(plant.workspace), "MLflow was not told of the versions that were there before")
    start = time.monotonic()
    plant.drop(coming[0])
    differs = settled(plant, machine, reference(coming[0]))
    if differs:
        raise RuntimeError(f"a part without a fault did not end well: {differs}")
    span = time.monotonic() - start
    say(f"a part without a fault takes {span:.0f} s in the plant")
    for victim, part in zip(VICTIMS, coming[1:], strict=True):
        said = _told(plant, victim)
        plant.drop(part)
        hits = 0
        for _ in range(kills):
            if victim == FORKS and plant.process_of(victim) is None and not any(plant.workspace.inbox.iterdir()):
                plant.drop(part)  # it is started again with the next run only: the same part comes once more
            hits += _kill(plant, victim, rng, span)
        found.append(_outcome(f"{victim}, iteration", hits, plant, machine, reference(part), said, victim))
        say(_line(found[-1]))
        if victim in (FORKS, "run of a part"):
            continue  # decisions have no run; kills of the deciding process itself are another kind
        said, hits = _told(plant, victim), 0
        expected: dict[str, Any] = {}
        for _ in range(kills):
            decision = next_decision(plant.workspace, machine)
            deciding = plant.decide(*decision)
            hits += _kill(plant, victim, rng, 2.0)
            if deciding.wait(PATIENCE_S):
                raise RuntimeError(f"pido {' '.join(decision)} failed:\n{plant.words()[-2000:]}")
            expected = reference(decision)
        found.append(_outcome(f"{victim}, promotion", hits, plant, machine, expected, said, victim))
        say(_line(found[-1]))
    return found


def next_decision(workspace: Workspace, machine: str) -> tuple[str, ...]:
    """Back to the champion before, or forth to the newest version that may be promoted."""
    passed = [v.version for v in Ledger(workspace.ledger).versions(machine) if v.gate.get("passed")]
    now = promotion.champion(workspace, machine)
    if now is not None and now.version == passed[-1]:
        return ("rollback",)
    return ("approve", str(passed[-1]))


def full_state(workspace: Workspace, machine: str) -> dict[str, Any]:
    """Parts, store and models (`chaos_attempts.state`), and which decisions were made."""
    decisions = [(r.action, r.version) for r in promotion.history(workspace, machine)]
    now = promotion.champion_bundle(workspace, machine)
    return {**state(workspace, machine), "decisions": decisions, "champion": now.content["models"] if now else None}


def zombies(plant: Plant) -> Outcome:
    """Two minutes after the last kill: runs that say they have a process and have none, and processes that nobody
    looks after."""
    from prefect.client.orchestration import get_client
    from prefect.client.schemas.filters import FlowRunFilter, FlowRunFilterState, FlowRunFilterStateType
    from prefect.client.schemas.objects import StateType

    time.sleep(ZOMBIE_S)
    busy = [StateType.RUNNING, StateType.PENDING, StateType.CANCELLING]
    wanted = FlowRunFilter(state=FlowRunFilterState(type=FlowRunFilterStateType(any_=busy)))
    with plant.as_client(), get_client(sync_client=True) as client:
        runs = client.read_flow_runs(flow_run_filter=wanted)
        total = client.count_flow_runs()
    dead = [run.name for run in runs if not plant.workspace.locked(f"run {run.id}")]
    strays = [c for p, c in processes(str(plant.folder)) if not _is_below(p, plant._process.pid)]
    for one in [*dead, *strays]:
        print(f"left over: {one}", file=sys.stderr)
    return Outcome(f"zombies among {total} runs", 0, 0, len(dead), len(strays), not dead and not strays)


def processes(about: str = "") -> list[tuple[int, str]]:
    """(process id, command line) of all others that can be seen and have `about` in command line or environment."""
    found = []
    for place in Path("/proc").glob("[0-9]*"):
        if int(place.name) == os.getpid():
            continue
        try:
            command = (place / "cmdline").read_bytes().replace(b"\0", b" ").decode(errors="replace").strip()
            own = command if about in command else (place / "environ").read_bytes().decode(errors="replace")
        except OSError:
            continue  # ended meanwhile, or somebody else's
        if about in own:
            found.append((int(place.name), command))
    return found


def until(look: Callable[[], Any], fault: str, check: Callable[[], None] = lambda: None) -> Any:
    """What `look` returns once it is true. Raises RuntimeError(fault) after PATIENCE_S."""
    end = time.monotonic() + PATIENCE_S
    while not (found := look()):
        check()
        if time.monotonic() > end:
            raise RuntimeError(fault)
        time.sleep(0.5)
    return found


def _kill(plant: Plant, victim: str, rng: random.Random, span: float) -> int:
    """kill -9 at a random moment; one that is not there any more, or not yet again, is waited for."""
    if victim == "run of a part":
        until(lambda: plant.process_of(victim) or not any(plant.workspace.inbox.iterdir()), "no run was asked for")
        time.sleep(rng.uniform(0, 0.3 * span))
        if (process := plant.process_of(victim)) is None:
            return 0  # the part is done
    else:
        time.sleep(rng.uniform(0, span))
        process = until(lambda: plant.process_of(victim), f"{victim} was not started again")
    try:
        os.kill(process, signal.SIGKILL)
    except ProcessLookupError:
        return 0
    return 1


def settled(plant: Plant, machine: str, expected: dict[str, Any]) -> str:
    """'' once everything is as expected, nothing is in the inbox, MLflow knows everything; else what differs."""

    def differs() -> str:
        place = plant.workspace
        if not plant.well():
            return "a service is not well"
        if any(place.inbox.iterdir()):
            return f"still in the inbox: {[p.name for p in place.inbox.iterdir()]}"
        if not mirror.up_to_date(place):
            return "MLflow has not been told everything"
        found = full_state(place, machine)
        return ", ".join(name for name in expected if found[name] != expected[name]) or asked()

    def asked() -> str:
        from mlflow.exceptions import MlflowException

        try:
            return in_mlflow(plant, machine)
        except MlflowException as error:  # it says that it is well a little before its database is
            return str(error).splitlines()[0]

    end = time.monotonic() + PATIENCE_S
    while (fault := differs()) and time.monotonic() < end:
        time.sleep(1.0)
    return fault


def in_mlflow(plant: Plant, machine: str) -> str:
    """'' where MLflow has every iteration once, every version of each model once, and the champion's alias."""
    from mlflow import MlflowClient

    from pido.tracking.mlflow_store import KEY, VERSION, model_names

    with plant.as_client():
        client = MlflowClient(plant.settings.mlflow_uri, plant.settings.mlflow_uri)
        found = client.get_experiment_by_name(f"pido {machine}")
        if found is None:
            return "no experiment in MLflow"
        runs = client.search_runs([found.experiment_id], max_results=1000)
        keys = sorted(run.data.tags[KEY] for run in runs if run.info.status == "FINISHED")
        if keys != sorted(i.run_key for i in Ledger(plant.workspace.ledger).iterations(machine)):
            return f"{len(keys)} runs in MLflow are not the iterations of the ledger"
        now = promotion.champion(plant.workspace, machine)
        for name in model_names(machine).values():
            numbers = [v.tags[VERSION] for v in client.search_model_versions(f"name = '{name}'")]
            if len(numbers) != len(set(numbers)):
                return f"{name} has a version twice: {numbers}"
            if now and client.get_model_version_by_alias(name, "champion").tags[VERSION] != str(now.version):
                return f"the alias of {name} is not the champion"
    return ""


def _outcome(
    kind: str, hits: int, plant: Plant, machine: str, expected: dict[str, Any], said: int, victim: str
) -> Outcome:
    fault = settled(plant, machine, expected)
    if fault:
        print(f"{kind}: {fault}", file=sys.stderr)
    found = full_state(plant.workspace, machine)
    lost = len(set(expected["parts"]) - set(found["parts"])) + len(expected["decisions"]) - len(found["decisions"])
    doubled = len(found["parts"]) - len(set(found["parts"]))
    told = _told(plant, victim) - said
    if victim == FORKS:
        told = hits  # it is started again with the next run; a run that was at work goes on to its end
    if told < hits:
        print(f"{kind}: {hits} kills, but {told} lines about them", file=sys.stderr)
    return Outcome(kind, hits, hits, max(lost, 0), doubled, not fault and told >= hits)


def _told(plant: Plant, victim: str) -> int:
    """Lines so far that say that this victim died."""
    if victim == "run of a part":
        return len(re.findall(r"exited with status code: -9", _log_of(plant, "worker")))
    name = {"PostgreSQL": "postgres", "Prefect server": "prefect", "MLflow server": "mlflow"}.get(victim, victim)
    return len(re.findall(rf"^{name} ended with -9", plant.words(), flags=re.MULTILINE))


def _log_of(plant: Plant, service: str) -> str:
    return (plant.folder / "logs" / f"{service}.log").read_text(encoding="utf-8", errors="replace")


def _is_below(process: int, ancestor: int) -> bool:
    while process > 1 and process != ancestor:
        process = _parent(process)
    return process == ancestor


def _parent(process: int) -> int:
    """0 where it has ended meanwhile."""
    try:
        text = Path(f"/proc/{process}/stat").read_text()
    except OSError:
        return 0
    return int(text.rpartition(")")[2].split()[1])


def _line(found: Outcome) -> str:
    return f"{found.kind}: {found.faults} kills, {'clean' if found.clean else 'NOT CLEAN'}"
