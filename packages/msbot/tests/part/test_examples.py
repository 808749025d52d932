"""The examples are short, run as they are, and stand in the tutorial word for word."""

import asyncio
import os
import re
import signal
import sys
import textwrap
from pathlib import Path

import pytest

from msbot.config import open_blueprint, write_sample
from tests import ROOT
from tests.part.test_run import complaints, master_on_udp, until
from tests.part.wire import publishes, subscribes

EXAMPLES = sorted((ROOT / "examples").glob("*.py"))
TUTORIAL = (ROOT / "docs/tutorial/first_part.md").read_text()

BINDINGS = {
    "ABCD": [publishes("out", "1_to_2"), subscribes("in", "3_to_1")],
    "EFGH": [publishes("out", "2_to_3"), subscribes("in", "1_to_2")],
    "WXYZ": [publishes("out", "3_to_1"), subscribes("in", "1_to_2")],
    "BLINK-1": [publishes("light", "blink", "Switch")],
    "LUX-1": [publishes("light", "light", "Light")],
    "LAMP-1": [subscribes("dim", "dim", "Dim")],
    "FAN-5V": [subscribes("power", "power", "Level")],
}


@pytest.mark.parametrize("example", EXAMPLES, ids=lambda path: path.stem)
def test_an_example_has_at_most_15_lines(example: Path) -> None:
    assert len(example.read_text().splitlines()) <= 15


@pytest.mark.parametrize("name", re.findall(r"`examples/(\w+\.py)`", TUTORIAL))
def test_the_tutorial_shows_the_example_as_it_is(name: str) -> None:
    shown = [textwrap.dedent(block) for block in re.findall(r"```python\n(.*?)```", TUTORIAL, re.DOTALL)]
    assert (ROOT / "examples" / name).read_text() in shown


def test_the_tutorials_own_kinds_of_part_are_right(tmp_path: Path) -> None:
    blocks = [textwrap.dedent(block) for block in re.findall(r"```toml\n(.*?)```", TUTORIAL, re.DOTALL)]
    fan_slots, lamp, dial, library_line, lamp_slots = blocks
    (tmp_path / "library").mkdir()
    for name, text in (("lamp-1", lamp), ("dial-1", dial)):
        (tmp_path / f"library/{name}.toml").write_text(text)
    path = tmp_path / "robot.toml"
    write_sample(path)
    path.write_text(library_line + path.read_text() + fan_slots + lamp_slots)
    blueprint, library = open_blueprint(path)
    assert [slot.name for slot in blueprint.slots][3:] == ["fan", "knob", "lamp", "dial"]
    port = library.require("LAMP-1").port("dim")
    assert port is not None
    assert port.safe == {"percent": 0.0}


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
        await until(lambda: len(master.configured) == len(EXAMPLES))
        listener = processes[2].stdout
        assert listener is not None
        assert await asyncio.wait_for(listener.readline(), 20.0) == b"Publisher A(1) turn-on 3\n"
        for process in processes:
            process.send_signal(signal.SIGINT)
        ends = [await process.communicate() for process in processes]
        assert [complaints(err) for _, err in ends] == [[]] * len(EXAMPLES)
        assert [process.returncode for process in processes] == [0] * len(EXAMPLES)
