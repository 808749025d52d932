"""The examples are short, run as they are, and stand in the tutorial word for word."""

import asyncio
import os
import re
import signal
import sys
import textwrap
from pathlib import Path

import pytest

from msbot.config import load_blueprint, load_library, write_sample
from tests.part.test_run import master_on_udp, until
from tests.part.wire import publishes, subscribes

ROOT = Path(__file__).parents[2]
EXAMPLES = sorted((ROOT / "examples").glob("*.py"))
TUTORIAL = (ROOT / "docs/tutorial/first_part.md").read_text()

BINDINGS = {
    "ABCD": [publishes("out", "1_to_2"), subscribes("in", "3_to_1")],
    "EFGH": [publishes("out", "2_to_3"), subscribes("in", "1_to_2")],
    "WXYZ": [publishes("out", "3_to_1"), subscribes("in", "1_to_2")],
    "LUX-1": [publishes("light", "light", "Light")],
    "FAN-5V": [subscribes("power", "power", "Level")],
}


@pytest.mark.parametrize("example", EXAMPLES, ids=lambda path: path.stem)
def test_an_example_has_at_most_15_lines(example: Path) -> None:
    assert len(example.read_text().splitlines()) <= 15


@pytest.mark.parametrize("name", re.findall(r"`examples/(\w+\.py)`", TUTORIAL))
def test_the_tutorial_shows_the_example_as_it_is(name: str) -> None:
    shown = [textwrap.dedent(block) for block in re.findall(r"```python\n(.*?)```", TUTORIAL, re.DOTALL)]
    assert (ROOT / "examples" / name).read_text() in shown


def test_the_tutorials_own_kind_of_part_is_right(tmp_path: Path) -> None:
    part_type, slot = (textwrap.dedent(block) for block in re.findall(r"```toml\n(.*?)```", TUTORIAL, re.DOTALL))
    (tmp_path / "library").mkdir()
    (tmp_path / "library/lux-1.toml").write_text(part_type)
    blueprint = tmp_path / "robot.toml"
    write_sample(blueprint)
    blueprint.write_text(blueprint.read_text() + slot)
    assert load_blueprint(blueprint, load_library(tmp_path / "library")).slot("eye") is not None


async def test_every_example_joins_a_robot_and_ends_on_ctrl_c(tmp_path: Path) -> None:
    async with master_on_udp(BINDINGS) as (master, link):
        processes = [
            await asyncio.create_subprocess_exec(
                sys.executable,
                str(example),
                "--link",
                link,
                "--quiet",
                env={**os.environ, "XDG_STATE_HOME": str(tmp_path / example.stem)},
                stdout=asyncio.subprocess.PIPE,
                stderr=asyncio.subprocess.PIPE,
            )
            for example in EXAMPLES
        ]
        fetched = lambda: [kind for kind, _ in master.requests].count("configuration") == len(EXAMPLES)  # noqa: E731
        await until(fetched)
        listener = processes[1].stdout
        assert listener is not None
        assert await asyncio.wait_for(listener.readline(), 20.0) == b"Publisher A(1) turn-on 3\n"
        for process in processes:
            process.send_signal(signal.SIGINT)
        ends = [await process.communicate() for process in processes]
        assert [err for _, err in ends] == [b""] * len(EXAMPLES)
        assert [process.returncode for process in processes] == [0] * len(EXAMPLES)
