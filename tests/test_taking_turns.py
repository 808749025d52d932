"""The workers of a run: who gets which file."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from conftest import FIRST
from tests import FOLDERS, ROOT
from tests.taking_turns import BROWSERS, WAITING, TakingTurns


class Worker:
    """Notes what it is to do."""

    shutting_down = False

    def __init__(self, name: str, tests: list[str]) -> None:
        self.gateway = SimpleNamespace(id=name)
        self.tests = tests
        self.todo: list[int] = []

    def send_runtest_some(self, indices: list[int]) -> None:
        self.todo += indices

    def shutdown(self) -> None:
        self.shutting_down = True


def play(workers: int, files: list[str], tests_each: int = 3) -> list[str]:
    """Run all, each worker one test at a time in turns; what each of them does at each moment: `b` something with a
    browser, `w` something that waits, `c` something that computes, `-` nothing."""
    tests = [f"{file}::test_{number}" for file in files for number in range(tests_each)]
    options = SimpleNamespace(tx=[f"{workers}*popen"], loadscopereorder=False, px=[])
    config: Any = SimpleNamespace(option=options, getvalue=lambda name: getattr(options, name))
    turns = TakingTurns(config)
    turns.numnodes = workers
    nodes: list[Any] = [Worker(f"gw{number}", tests) for number in range(workers)]
    for node in nodes:
        turns.add_node(node)
        turns.add_node_collection(node, tests)
    turns.schedule()
    done: list[str] = []
    moments = []
    while any(node.todo for node in nodes):
        moments.append("".join(kind(tests[node.todo[0]]) if node.todo else "-" for node in nodes))
        for node in nodes:
            if node.todo:
                index = node.todo.pop(0)
                done.append(tests[index])
                turns.mark_test_complete(node, index)
    assert sorted(done) == sorted(tests), "each once"
    return moments


def kind(test: str) -> str:
    return "b" if test.startswith(BROWSERS) else "w" if test.startswith(WAITING) else "c"


def named(folder: str, number: int) -> list[str]:
    return [f"{folder}test_{one}.py" for one in range(number)]


def test_two_of_five_workers_have_a_browser_two_wait_and_one_computes() -> None:
    moments = play(5, named(BROWSERS, 6) + named(WAITING[0], 12) + named("tests/", 16))
    assert moments[:7] == ["bbwwc"] * 7
    for moment in moments[:-12]:  # at the end each does what there is
        assert moment.count("b") <= 2
        assert moment.count("b") + moment.count("w") <= 4
    assert "b" not in moments[-1]


def test_without_browsers_three_of_five_workers_wait_and_two_compute() -> None:
    moments = play(5, named(WAITING[0], 12) + named("tests/", 16))
    assert {moment.count("w") for moment in moments[:10]} == {3}


def test_of_three_workers_one_has_a_browser_and_keeps_it() -> None:
    moments = play(3, named(BROWSERS, 4) + named(WAITING[0], 20) + named("tests/", 20))
    assert {moment for moment in moments if "b" in moment} == {"bwc"}


def test_at_the_end_all_help_and_one_worker_alone_does_all() -> None:
    assert set(play(3, named(BROWSERS, 6))) == {"bbb"}
    assert set(play(1, [*named(BROWSERS, 2), *named(WAITING[0], 2), "tests/test_more.py"])) == {"b", "w", "c"}


def test_it_is_in_use() -> None:
    words = ["-m", "pytest", "-v", "-n", "1", "--dist", "loadfile", "-p", "no:cacheprovider", "tests/test_errors.py"]
    done = subprocess.run([sys.executable, *words], cwd=ROOT, capture_output=True, text=True, check=False)
    assert "scheduling tests via TakingTurns" in done.stdout
    assert done.returncode == 0, done.stdout + done.stderr


def test_what_has_a_place_in_the_order_or_a_kind_is_there() -> None:
    """A file that got another name would lose its place without a word."""
    names = [next((path for folder in FOLDERS if (path := folder / name).exists()), Path(name)) for name in FIRST]
    names += [ROOT / name for name in (BROWSERS, *WAITING)]
    assert [path for path in names if not path.exists()] == []
    assert {path.name for path in (ROOT / BROWSERS).glob("test_*.py")} <= {path.name for path in names}
