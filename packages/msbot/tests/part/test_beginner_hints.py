"""Every beginner's mistake is one sentence with its line, and a part never keeps silent: the sentences are read."""

from __future__ import annotations

import asyncio
import logging
import os
import re
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from msbot import HelloWorld, JoinState, Part
from msbot.part.join.refusal import Refusal
from msbot_xrce.errors import ConfigError, LocalProtocolError
from tests.part.test_part import Room, make_part, play
from tests.part.wire import publishes

HEAD = "from msbot import HelloWorld, Part\npart = Part('ABCD')\n"


def test_a_mistake_in_msbot_part_is_no_beginners_mistake(tmp_path: Path) -> None:
    script = tmp_path / "msbot"  # as pip writes it
    script.write_text("import sys\nfrom msbot_agent.cli import main\nsys.exit(main())\n")
    done = subprocess.run(
        [sys.executable, str(script), "part", "SG90", "--set", "nix=1"],
        cwd=tmp_path,
        env={**os.environ, "XDG_STATE_HOME": str(tmp_path)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 2
    assert done.stderr == "msbot: part SG90 has no control 'nix'; controls: it has none\n"


MISTAKES = {
    "run is forgotten": (
        HEAD + "@part.every(1.0)\ndef tell():\n    pass\n",
        "program.py:2: part ABCD was made and never run: end the program with part.run(), "
        "or msbot.run(part, ...) for several",
    ),
    "every without parentheses": (
        HEAD + "@part.every\ndef tell():\n    pass\npart.run()\n",
        "program.py:3: @part.every above tell needs the seconds in parentheses: @part.every(1.0)",
    ),
    "on without parentheses": (
        HEAD + "@part.on\ndef hear(message):\n    pass\npart.run()\n",
        'program.py:3: @part.on above hear needs port and message: @part.on("in", HelloWorld)',
    ),
    "on without a message": (
        HEAD + "@part.on('in')\ndef hear(message):\n    pass\npart.run()\n",
        "program.py:3: @part.on('in', ...) needs the class of the message: on('in', HelloWorld)",
    ),
    "on_join with parentheses": (
        HEAD + "@part.on_join()\ndef begin():\n    pass\npart.run()\n",
        "program.py:3: @part.on_join is written without parentheses",
    ),
    "a function with too many arguments": (
        HEAD + "@part.every(1.0)\ndef tell(message):\n    pass\npart.run()\n",
        "program.py:3: tell must take no arguments: write `def tell()`",
    ),
    "positional fields": (
        HEAD + "HelloWorld(1, 'hello')\npart.run()\n",
        "program.py:3: HelloWorld takes its fields by name: HelloWorld(index=..., message=...)",
    ),
    "publish before run": (
        HEAD + "part.publish('out', HelloWorld(index=1, message='x'))\npart.run()\n",
        "program.py:3: the part does not run: publish in a function below @part.every or @part.on",
    ),
    "publish in another thread before run": (
        "import threading\n"
        + HEAD
        + "thread = threading.Thread(target=lambda: part.publish('out', HelloWorld(index=1, message='x')))\n"
        "thread.start()\nthread.join()\nimport os\nos._exit(0)\n",
        "program.py:4 in <lambda>: the part does not run: publish in a function below @part.every or @part.on",
    ),
    "a field without a size, before any part is made": (
        "from msbot import Message\nclass Light(Message):\n    value: int\n",
        "program.py:2: class Light: field value: int says no size on the wire: "
        "write int32 (or int8, int16, int64, uint8 to uint64)",
    ),
    "a field without a form": (
        "from msbot import Message\nclass Light(Message):\n    value: float\n",
        "program.py:2: class Light: field value: float says no size on the wire: write float32 (or float64)",
    ),
    "seconds with their unit": (
        HEAD + "@part.every('1s')\ndef tell():\n    pass\npart.run()\n",
        'program.py:3: every("1s"): seconds are a number without quotes: every(1); a text is the name of a setting',
    ),
    "a value that does not fit": (
        HEAD + "HelloWorld(index=-1, message='x')\npart.run()\n",
        "program.py:3: HelloWorld.index cannot be -1: uint32 needs a whole number from 0 to 4294967295",
    ),
}


@pytest.mark.parametrize(("program", "told"), MISTAKES.values(), ids=MISTAKES.keys())
def test_a_mistake_is_one_sentence_with_its_line(program: str, told: str, tmp_path: Path) -> None:
    (tmp_path / "program.py").write_text(program)
    done = subprocess.run(
        [sys.executable, "program.py"], cwd=tmp_path, capture_output=True, text=True, timeout=60, check=False
    )
    assert done.stderr == f"{told}\n"
    assert done.stdout == ""


def test_a_program_that_ends_with_its_own_error_is_told_that_only(tmp_path: Path) -> None:
    (tmp_path / "program.py").write_text(HEAD + "1 / 0\n")
    done = subprocess.run(
        [sys.executable, "program.py"], cwd=tmp_path, capture_output=True, text=True, timeout=60, check=False
    )
    assert done.stderr.splitlines()[-1] == "ZeroDivisionError: division by zero"
    assert "never run" not in done.stderr


SLEEPER = """
from msbot.part.handler_guard import Guard
import asyncio
from msbot.part.beginner_hints import HandlerWatch
import logging
logging.basicConfig(format="%(message)s")

def wait():
    print(input())      # nothing comes before the sentence has been said

async def main():
    guard = Guard(print)
    watch = HandlerWatch(lambda: guard.running)
    guard.call(wait)
    watch.end()

asyncio.run(main())
import os
os._exit(0)
"""


def test_a_function_that_waits_is_told_of_while_it_does(tmp_path: Path) -> None:
    (tmp_path / "program.py").write_text(SLEEPER)
    with subprocess.Popen(
        [sys.executable, "-u", "program.py"],
        cwd=tmp_path,
        stdin=subprocess.PIPE,
        stderr=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    ) as process:
        assert process.stderr is not None
        said = process.stderr.readline()  # comes though the function has not returned
        assert process.poll() is None
        process.communicate("go on\n", timeout=60)
    assert said.startswith("program.py:9: wait has not returned yet, and the part cannot beat meanwhile: ")


# While it runs


def test_no_master_is_told_after_two_seconds(caplog: pytest.LogCaptureFixture) -> None:
    async def scenario(room: Room) -> None:
        await room.master.kill()
        room.plug(make_part())
        await asyncio.sleep(1.9)
        assert "no master" not in caplog.text
        await asyncio.sleep(0.2)
        assert "no master at" in caplog.text
        assert "yet, still looking; is `msbot master` running?" in caplog.text

    play(scenario)


def test_a_robot_that_does_not_answer_is_told(caplog: pytest.LogCaptureFixture) -> None:
    async def scenario(room: Room) -> None:
        room.plug(Part("NOBODY", robot="MSBOT_MASTER", uid=bytes(range(8))))
        await asyncio.sleep(3.0)
        assert "the robot does not answer part NOBODY; `msbot why NOBODY` beside the master says why" in caplog.text

    play(scenario)


def test_a_refusal_is_told_with_its_reason_and_every_new_reason_too(caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level("INFO")

    async def scenario(room: Room) -> None:
        room.master.refuse = Refusal.DUPLICATE
        room.plug(make_part())
        await asyncio.sleep(1.0)
        assert f"is refused: {Refusal.DUPLICATE.describe}" in caplog.text
        room.master.refuse = Refusal.NO_SLOT
        await asyncio.sleep(3.0)
        assert f"is standby: {Refusal.NO_SLOT.describe}" in caplog.text, "a spare that waits, as the master calls it"
        assert caplog.text.count(Refusal.NO_SLOT.describe) == 1

    play(scenario)


def test_a_text_without_end_is_told_with_its_line_and_the_part_goes_on(caplog: pytest.LogCaptureFixture) -> None:
    async def scenario(room: Room) -> None:
        part, text = make_part(), ["x" * 100_000]

        @part.every(1.0)
        def tell() -> None:
            text[0] += "x" * 100_000
            part.publish("out", HelloWorld(index=1, message=text[0]))

        room.plug(part)
        await asyncio.sleep(5.0)
        (line,) = [record.getMessage() for record in caplog.records if "bytes" in record.getMessage()]
        assert re.match(
            r"test_beginner_hints\.py:\d+ in tell: LocalProtocolError: this HelloWorld has 300,0\d\d bytes, ", line
        )
        assert "one message may have 262,000: does a text or list in it grow without end?" in line
        assert part.state is JoinState.ACTIVE

    play(scenario, {"ABCD": [publishes("out", "t")]})


def test_verbose_shows_the_whole_traceback_of_a_handler(caplog: pytest.LogCaptureFixture) -> None:
    async def scenario(room: Room) -> None:
        part = make_part()

        @part.every(1.0)
        def divide() -> None:
            _ = 1 / 0

        with caplog.at_level("DEBUG"):
            room.plug(part)
            await asyncio.sleep(1.0)
        (story,) = {record.getMessage(): record for record in caplog.records if record.exc_info}.values()
        assert "in divide: the whole story (-v)" in story.getMessage()
        assert story.levelname == "DEBUG"
        shown = logging.Formatter().format(story)
        assert "Traceback (most recent call last)" in shown
        assert "_ = 1 / 0" in shown

    play(scenario, {"ABCD": [publishes("out", "t")]})


def test_on_at_a_port_that_publishes(caplog: pytest.LogCaptureFixture) -> None:
    async def scenario(room: Room) -> None:
        part = make_part()
        part.on("out", HelloWorld)(lambda message: None)
        room.plug(part)
        await asyncio.sleep(0.5)
        assert "port 'out': publishes, so nothing comes in there: use part.publish('out', ...)" in caplog.text

    play(scenario, {"ABCD": [publishes("out", "t")]})


def test_publish_from_another_thread_while_it_runs() -> None:
    async def scenario(room: Room) -> None:
        part = make_part()
        room.plug(part)
        await asyncio.sleep(1.0)
        assert part.state is JoinState.ACTIVE
        with ThreadPoolExecutor(1, "helper") as pool:
            wrong = pool.submit(part.publish, "out", HelloWorld(index=1, message="x")).exception(10)
        assert isinstance(wrong, LocalProtocolError)
        assert str(wrong) == (
            "publish was called from another thread (helper_0): call it in a function below @part.every or @part.on"
        )
        assert part.publish("out", HelloWorld(index=2, message="y"))

    play(scenario, {"ABCD": [publishes("out", "t")]})


def test_errors_have_their_kinds() -> None:
    part = Part("ABCD")
    with pytest.raises(ConfigError, match="seconds in parentheses"):
        part.every(print)  # type: ignore[arg-type]
    with pytest.raises(LocalProtocolError, match="by name"):
        HelloWorld(1, "x")  # type: ignore[call-arg]
