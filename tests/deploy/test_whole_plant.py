"""A whole plant as `make plant` starts it: parts arrive, a version is promoted, people look at it in a browser, all of
it is saved, destroyed and brought back. One plant for all tests of this module, in their order."""

from __future__ import annotations

import base64
import json
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from urllib.parse import quote

import chromium
import httpx
import pytest
from plain_parts import parts as made_up
from plain_parts import with_simulation

from benchmarks.plant_chaos import Plant, full_state, in_mlflow, settled, until
from deploy import postgres
from pido.recordings.folder import write_folder
from pido.tracking import promotion
from pido.tracking.ledger import Ledger

MACHINE = "cmx600v"
ITERATION, DIAGNOSIS, REPORT = (f"{kind}-{MACHINE}" for kind in ("iteration", "diagnosis", "diagnosis-report"))
SETTINGS = "[method]\nadaptive = false\ncompare_with_model = false\n"
PARTS = 3
PATIENCE_S = 300
TRAINING = "workflowType=machine_learning"
"""Without it MLflow shows a run among its pages for language models."""

pytestmark = [
    pytest.mark.servers,
    pytest.mark.slow,
    pytest.mark.skipif(not postgres.is_installed(), reason="PostgreSQL is missing (apt-get install postgresql)"),
    pytest.mark.filterwarnings("ignore::DeprecationWarning"),
    pytest.mark.filterwarnings("ignore::ResourceWarning"),
]


@pytest.fixture(scope="module")
def place() -> Iterator[Path]:
    """Where the database's own user may enter, which pytest's temporary folders are not."""
    folder = Path(tempfile.mkdtemp(prefix="pido-plant-", dir="/tmp"))
    folder.chmod(0o755)
    yield folder
    shutil.rmtree(folder)


@pytest.fixture(scope="module")
def plant(place: Path) -> Iterator[Plant]:
    (place / "old" / "workspace").mkdir(parents=True)
    (place / "old" / "workspace" / "workspace.toml").write_text(SETTINGS)
    with Plant(place / "old", place / "old.log") as running, running.as_client():
        for part in made_up(PARTS):
            folder = write_folder(with_simulation(part).rows(slice(0, 700)), place / "parts" / part.part.part)
            running.drop(folder)
        yield running


def artifacts(plant: Plant) -> dict[str, str]:
    """Key -> content of the newest artifact on Prefect's pages. Asked for without Prefect's client, which keeps the
    address of the first server that a process has talked to."""
    settings = plant.settings
    login = (settings.prefect_user, settings.prefect_password)
    reply = httpx.post(f"{settings.prefect_api}/artifacts/filter", json={}, auth=login, timeout=PATIENCE_S)
    found = sorted(reply.raise_for_status().json(), key=lambda a: a["created"])
    return {a["key"]: str(a["data"]) for a in found if a["key"]}


def test_parts_that_arrive_are_taken_and_a_version_that_passed_its_gate_is_promoted_from_the_command_line(plant):
    ledger = Ledger(plant.workspace.ledger)
    until(lambda: len(ledger.parts(MACHINE)) == PARTS, "the parts were not taken")
    assert settled(plant, MACHINE, {}) == ""
    version = [v.version for v in ledger.versions(MACHINE) if v.gate["passed"]][-1]
    assert plant.decide("approve", str(version)).wait(120) == 0
    record = promotion.champion(plant.workspace, MACHINE)
    assert record is not None
    assert (record.version, record.by) == (version, "chaos")
    assert settled(plant, MACHINE, {}) == "", "MLflow's aliases have followed"


def test_the_physics_of_the_newest_parts_was_looked_at(plant):
    found = until(lambda: {ITERATION, DIAGNOSIS} <= set(artifacts(plant)) and artifacts(plant), "no diagnosis")
    assert f"Diagnosis of {MACHINE}" in found[DIAGNOSIS]
    until(lambda: REPORT in artifacts(plant), "no link to the report in MLflow")
    assert "RMSE" in found[ITERATION]


@pytest.fixture(scope="module")
def browser():
    """A Chromium without a window. PIDO_SCREENSHOTS names a folder for pictures of what it saw."""
    # It is told none of the plant's passwords, and its processes are not taken for the plant's.
    own = {name: value for name, value in os.environ.items() if not name.startswith(("PREFECT_", "MLFLOW_", "PIDO_"))}
    with chromium.started("1600,1300", own) as found:
        found.set_page_load_timeout(PATIENCE_S)
        yield found


def shows(browser, picture: str, *words: str, also: Callable[[], bool] = lambda: True) -> None:
    """Wait until all words stand on the page, and `also`."""
    from selenium.webdriver.common.by import By
    from selenium.webdriver.support.wait import WebDriverWait

    def missing() -> list[str]:
        text = browser.find_element(By.TAG_NAME, "body").text
        return [word for word in words if word not in text]

    try:
        WebDriverWait(browser, PATIENCE_S, ignored_exceptions=[Exception]).until(lambda _: not missing() and also())
    finally:
        if folder := os.environ.get("PIDO_SCREENSHOTS"):
            browser.save_screenshot(str(Path(folder) / f"{picture}.png"))


def press(browser, place: str) -> None:
    """Click what the XPath finds."""
    from selenium.webdriver.common.by import By
    from selenium.webdriver.support import expected_conditions as seen
    from selenium.webdriver.support.wait import WebDriverWait

    WebDriverWait(browser, PATIENCE_S).until(seen.element_to_be_clickable((By.XPATH, place))).click()


def frame(browser) -> None:
    """Into the frame that MLflow shows an artifact in."""
    from selenium.webdriver.common.by import By
    from selenium.webdriver.support import expected_conditions as seen
    from selenium.webdriver.support.wait import WebDriverWait

    wait = WebDriverWait(browser, PATIENCE_S)
    wait.until(seen.frame_to_be_available_and_switch_to_it((By.TAG_NAME, "iframe")))


@pytest.fixture
def mlflow_pages(plant, browser):
    """Opens a place on MLflow's pages, logged in; and the experiment and the runs of the machine, newest first."""
    from mlflow import MlflowClient

    settings = plant.settings
    with plant.as_client():
        client = MlflowClient(settings.mlflow_uri, settings.mlflow_uri)
        experiment = client.get_experiment_by_name(f"pido {MACHINE}").experiment_id
        runs = sorted(client.search_runs([experiment]), key=lambda r: -int(r.data.tags["pido.version"]))
    login = f"{quote(settings.mlflow_user)}:{quote(settings.mlflow_password)}@"
    # Once, then without: pages under an address with a password in it may not ask the server for anything.
    browser.get(settings.mlflow_uri.replace("://", f"://{login}"))

    def visit(place: str) -> None:
        browser.get("about:blank")  # a page that differs behind the # alone is not loaded anew
        browser.get(f"{settings.mlflow_uri}/#/{place}")

    return visit, experiment, runs


@pytest.mark.browser
def test_mlflow_shows_the_machine_its_runs_and_what_an_engineer_asks_first(mlflow_pages, browser):
    visit, experiment, runs = mlflow_pages
    names = [run.info.run_name for run in runs]
    visit("experiments")
    shows(browser, "experiments", f"pido {MACHINE}")
    visit(f"experiments/{experiment}/runs?{TRAINING}")
    shows(browser, "runs", *names, "real (")
    press(browser, "//button[starts-with(normalize-space(), 'real (')]")
    shows(browser, "data", "v_x", "curr_sp", "pia")
    visit(f"experiments/{experiment}/runs/{runs[0].info.run_id}?{TRAINING}")
    shows(browser, "run", names[0], f"Version {PARTS}", "recorded rows", "Gate:", "real (", f"{MACHINE}-")
    both = quote(json.dumps([run.info.run_id for run in runs[:2]]))
    visit(f"compare-runs?runs={both}&experiments={quote(json.dumps([experiment]))}&{TRAINING}")
    shows(browser, "compare", *names[:2], "rmse_x/both")
    visit(f"models/{MACHINE}-x?{TRAINING}")
    shows(browser, "versions", "@ champion", "may be promoted", f"Version {PARTS}")


@pytest.mark.browser
def test_mlflow_shows_the_figures_of_an_iteration(mlflow_pages, browser):
    visit, experiment, runs = mlflow_pages
    visit(f"experiments/{experiment}/runs/{runs[0].info.run_id}/artifacts/iteration/errors.png?{TRAINING}")
    shown = "return [...document.images].some(image => image.naturalWidth > 600)"
    shows(browser, "figure", "errors.png", also=lambda: browser.execute_script(shown))


@pytest.mark.browser
@pytest.mark.parametrize(
    ("path", "words"), [("report/index.html", "Did it get better?"), ("diagnosis/report.html", MACHINE)]
)
def test_a_report_is_shown_inside_mlflows_page(mlflow_pages, browser, path, words):
    visit, experiment, runs = mlflow_pages
    visit(f"experiments/{experiment}/runs/{runs[0].info.run_id}/artifacts/{path}?{TRAINING}")
    frame(browser)
    shows(browser, path.replace("/", "-"), words)
    browser.switch_to.default_content()


@pytest.mark.browser
def test_prefects_pages_show_the_iteration_the_diagnosis_and_the_way_to_its_report(plant, browser):
    settings = plant.settings
    root = settings.prefect_api.removesuffix("/api")
    browser.get(root)
    login = base64.b64encode(f"{settings.prefect_user}:{settings.prefect_password}".encode()).decode()
    browser.execute_script("localStorage.setItem('prefect-password', arguments[0])", login)
    pages = {
        ITERATION: (f"version {PARTS}", "with PiA and PiE"),
        DIAGNOSIS: (f"{MACHINE}: ", f"Diagnosis of {MACHINE}"),
        REPORT: (f"Diagnosis of {MACHINE}", MACHINE),
    }
    for key, (at_first_sight, words) in pages.items():
        browser.get("about:blank")
        browser.get(f"{root}/artifacts/key/{key}")
        shows(browser, f"prefect-{key}-list", at_first_sight)
        press(browser, "(//a[contains(@href, '/artifacts/artifact/')])[1]")
        shows(browser, f"prefect-{key}", words, "Flow Run")


def test_everything_comes_back_in_another_folder_after_the_plant_was_destroyed(plant, place):
    before = full_state(plant.workspace, MACHINE)
    assert len(before["parts"]) == PARTS
    call = [sys.executable, "-m", "deploy.plant", "--folder"]
    archive = str(place / "backup.tar")
    subprocess.run([*call, str(plant.folder), "backup", archive], check=True)
    plant.stop()
    assert plant.left() == [], "nothing of a plant that was stopped is left running"
    shutil.rmtree(plant.folder)
    subprocess.run([*call, str(place / "new"), "restore", archive], check=True)
    with Plant(place / "new", place / "new.log") as again, again.as_client():
        assert settled(again, MACHINE, before) == ""
        assert in_mlflow(again, MACHINE) == ""
        assert {ITERATION, DIAGNOSIS} <= set(artifacts(again))
    assert again.left() == []
