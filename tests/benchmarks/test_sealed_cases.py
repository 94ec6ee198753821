"""Any generator's cases can be asked group by group, without a change of the cases or of their numbers."""

from pathlib import Path

import pytest
from click.testing import CliRunner

from benchmarks.newcomer.planned import plan as newcomers
from benchmarks.sealed_cases import GROUPS, Generator, chosen, command
from benchmarks.sealed_truth import Task
from benchmarks.stranger.cases import plan as strangers

PLANS = pytest.mark.parametrize("plan", [strangers, newcomers], ids=["stranger", "newcomer"])


@PLANS
def test_every_group_of_a_plan_has_a_word_for_the_command_line(plan):
    assert {t.group for t in plan(100, 1)} == set(GROUPS.values())


@PLANS
def test_a_group_leaves_out_the_others_and_changes_neither_cases_nor_numbers(plan):
    tasks = plan(100, 1)
    some = chosen(tasks, 10, 80, ["box", "outside"])
    assert set(some) == {k for k in range(10, 80) if tasks[k].group in (GROUPS["box"], GROUPS["outside"])}
    assert all(tasks[k] == task for k, task in some.items())
    assert chosen(tasks, 10, 80, []) == {k: tasks[k] for k in range(10, 80)}
    each = [set(chosen(tasks, 0, None, [word])) for word in GROUPS]
    assert sum(map(len, each)) == len(set.union(*each)) == 100


def test_drawn_cases_of_a_group_are_named_by_their_numbers_in_the_plan(tmp_path):
    tasks = [Task("clean" if k % 3 == 0 else "single", "", 1.0, k) for k in range(12)]
    written = {}

    def write(task: Task, folder: Path, sealed: Path) -> list[Path]:
        written[folder.name] = task.seed
        return [folder]

    some = command(Generator("benchmarks.none", "none", lambda cases, seed: tasks[:cases], write))
    call = ["--group", "clean", "--from", "3", "--to", "9", "--draw", str(tmp_path)]
    assert CliRunner().invoke(some, call, catch_exceptions=False).exit_code == 0
    assert written == {"case_003": 3, "case_006": 6}
    assert CliRunner().invoke(some, [*call, "--cases", "3"]).exit_code == 2
