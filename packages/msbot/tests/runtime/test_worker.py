"""Work in a process of its own: results, errors, and what happens at the limits."""

from __future__ import annotations

import asyncio
import os
import re
import subprocess
import sys

import pytest

from msbot.config import InvalidFileError, Library, load_library, parse_blueprint
from msbot.config.blueprint.samples import SAMPLE_ROBOT_TOML
from msbot.process.worker_pool import AT_ONCE, WorkerPool, WorkLimits, run_limited
from msbot_xrce.errors import ConfigError
from tests import ROOT
from tests.runtime.work import chatter, eat_memory, eat_time, fail, process_number, refuse

LIMITS = WorkLimits()
PROJECT = ROOT
has_limits = pytest.mark.skipif(sys.platform == "win32", reason="Windows has no limits for processes")


def test_it_runs_elsewhere_and_gives_the_result() -> None:
    assert run_limited(process_number, LIMITS) != os.getpid()


def test_a_blueprint_comes_back_whole() -> None:
    library = load_library()
    apart = run_limited(parse_blueprint, LIMITS, SAMPLE_ROBOT_TOML, library, "robot.toml")
    assert apart == parse_blueprint(SAMPLE_ROBOT_TOML, library)


def test_problems_come_back_as_they_are() -> None:
    text = SAMPLE_ROBOT_TOML.replace('"EFGH"', '"EFGX"')
    with pytest.raises(InvalidFileError, match="line 34, slot") as caught:
        run_limited(parse_blueprint, LIMITS, text, Library(load_library()), "robot.toml")
    assert caught.value.problems[0].place.line == 34


def test_an_error_for_a_person_comes_back_and_a_mistake_of_ours_with_its_traceback() -> None:
    with pytest.raises(ConfigError, match="no such thing"):
        run_limited(refuse, LIMITS, "no such thing")
    with pytest.raises(RuntimeError, match="'a bug'"):
        run_limited(fail, LIMITS)


def test_what_is_printed_there_does_not_spoil_the_answer() -> None:
    assert run_limited(chatter, LIMITS) == "done"


@has_limits
def test_too_much_memory_is_refused() -> None:
    with pytest.raises(ConfigError, match="needs more than 200 MB of memory"):
        run_limited(eat_memory, WorkLimits(memory_mb=200))


@has_limits
def test_too_much_processor_time_is_refused() -> None:
    with pytest.raises(ConfigError, match="needs more than 1 s of processor time"):
        run_limited(eat_time, WorkLimits(cpu_s=1, wall_s=120))  # on a busy computer a second takes its time


@has_limits
def test_a_limit_of_whoever_has_started_the_robot_stays_and_is_no_obstacle() -> None:
    program = (
        "import resource; resource.setrlimit(resource.RLIMIT_CPU, (50, 50))\n"
        "from msbot.process.worker_pool import WorkLimits, run_limited\n"
        "from tests.runtime.work import processor_limits\n"
        "print(*(run_limited(processor_limits, WorkLimits(cpu_s=cpu_s)) for cpu_s in (20, 100)))"
    )
    there = os.environ | {"PYTHONPATH": str(PROJECT)}
    done = subprocess.run([sys.executable, "-c", program], env=there, capture_output=True, text=True, check=False)
    assert re.fullmatch(r"\(2\d, 50\) \(50, 50\)\n", done.stdout), done.stdout + done.stderr


def test_who_gives_no_answer_is_ended() -> None:
    with pytest.raises(ConfigError, match="did not come to an end"):
        run_limited(eat_time, WorkLimits(cpu_s=60, wall_s=0.2))


async def test_the_loop_goes_on_meanwhile_and_who_comes_too_late_is_sent_away() -> None:
    workshop = WorkerPool(most_waiting=1)
    turns = 0
    work = [asyncio.ensure_future(workshop.run(process_number)) for _ in range(AT_ONCE + 1)]
    await asyncio.sleep(0)
    with pytest.raises(ConfigError, match="try again in a moment"):
        await workshop.run(process_number)
    while not all(one.done() for one in work):
        turns += 1
        await asyncio.sleep(0.001)
    assert turns > 10
    assert len({one.result() for one in work}) == len(work)
    assert await workshop.run(process_number) != os.getpid()
