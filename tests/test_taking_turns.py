"""The workers of a run: who gets which file."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from tests.taking_turns import BROWSERS, TakingTurns


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


def play(workers: int, files: list[str], tests_each: int = 3) -> list[tuple[int, ...]]:
    """Run all, each worker one test at a time in turns; who has done which files with browsers at each moment."""
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
    with_browser = []
    while any(node.todo for node in nodes):
        running = [tests[node.todo[0]] if node.todo else "" for node in nodes]
        with_browser.append(tuple(number for number, test in enumerate(running) if test.startswith(BROWSERS)))
        for node in nodes:
            if node.todo:
                index = node.todo.pop(0)
                done.append(tests[index])
                turns.mark_test_complete(node, index)
    assert sorted(done) == sorted(tests), "each once"
    return with_browser


def test_one_of_three_workers_has_no_browser_as_long_as_there_is_other_work() -> None:
    files = [f"{BROWSERS}test_{number}.py" for number in range(5)] + [f"tests/test_{number}.py" for number in range(20)]
    moments = play(3, files)
    assert set(moments) == {(0, 1), (0,), ()}, "who has a browser keeps it"
    assert moments[-1] == ()


def test_at_the_end_all_help_and_one_worker_alone_does_all() -> None:
    files = [f"{BROWSERS}test_{number}.py" for number in range(6)]
    assert set(play(3, files)) == {(0, 1, 2)}
    assert set(play(1, [*files, "tests/test_more.py"])) == {(0,), ()}


def test_it_is_in_use() -> None:
    words = ["-m", "pytest", "-v", "-n", "1", "--dist", "loadfile", "-p", "no:cacheprovider", "tests/test_errors.py"]
    done = subprocess.run(
        [sys.executable, *words], cwd=Path(__file__).parents[1], capture_output=True, text=True, check=False
    )
    assert "scheduling tests via TakingTurns" in done.stdout
    assert done.returncode == 0, done.stdout + done.stderr
