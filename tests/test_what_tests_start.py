"""What tests have started ends with them, also when they are interrupted or killed."""

from __future__ import annotations

import os
import select
import subprocess
import sys
from pathlib import Path

import pytest

from tests.e2e.prepared import GROUP, Prepared
from tests.e2e.processes import run
from tests.socketcan import machine

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="made for Linux alone")
PATIENCE_S = 60.0


def test_the_copies_of_a_prepared_process_end_with_the_tests(tmp_path: Path) -> None:
    with open(tmp_path / "said", "wb") as said:
        prepared = Prepared()
        wish = (["agent", "udp4", "-p", "0"], str(tmp_path), dict(os.environ), None)
        copy = prepared.copy(wish, said.fileno(), said.fileno())
    ended = os.pidfd_open(copy.pid)
    try:
        assert copy.poll() is None
        prepared.leave()
        assert select.select([ended], [], [], PATIENCE_S)[0]
    finally:
        os.close(ended)
        copy.forget()


@pytest.mark.parametrize(("words", "env"), [(("--stop-group", ""), {}), ((), {GROUP: ""})])
def test_no_test_says_stop_to_the_robots_of_others(words: tuple[str, ...], env: dict[str, str]) -> None:
    with pytest.raises(AssertionError, match="would stop every robot on this computer"):
        run("stop", *words, env=env)


@pytest.mark.parametrize("tests_end", [False, True])
def test_a_virtual_machine_ends_with_the_tests(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, tests_end: bool
) -> None:
    ours, theirs = os.pipe()
    with os.fdopen(ours) as stdin, os.fdopen(theirs, "w") as tests:
        monkeypatch.setattr(sys, "stdin", stdin)
        with subprocess.Popen(["sleep", "1000" if tests_end else "0"]) as runner:
            if tests_end:
                tests.close()
                with pytest.raises(SystemExit):
                    machine._watch(runner, tmp_path / "reports")
                assert runner.returncode == -15
            else:
                assert machine._watch(runner, tmp_path / "reports") is False
                assert runner.returncode == 0
