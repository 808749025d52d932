"""A program on a simulated board, started by `msbot board run`, is a part of a real master; Ctrl-C ends it.

The board is MicroPython's VM with its own prompt behind a pseudo terminal (board.mjs in tests.homes); its UART is a
second pseudo terminal, at whose other end the master is.
"""

import json
import re
import signal
import time
from contextlib import ExitStack
from pathlib import Path

import pytest

from tests.e2e.processes import run, running, wait_for_states
from tests.e2e.test_processes import free_port
from tests.homes import micro
from tests.homes.runners import NODE
from tests.homes.simulated_board import simulated_board

pytestmark = pytest.mark.skipif(NODE is None, reason="needs node")
pytest.importorskip("mpremote")

PROGRAM = """\
from msbot import HelloWorld, Part

part = Part("ABCD", local_name="ABCD-local", robot="MSBOT_MASTER")


@part.every(0.2)
def speak():
    part.publish("out", HelloWorld(index=1, message="Publisher A(1) turn-on 3"))


part.run()
"""


PINS = Path(micro.__file__).with_name("fake_machine.py")
KEYS = """
[robot]
name = "R"

[options]
authentication = "key"

[[slot]]
name = "front board"
part = "BOARD-8"

[slot.settings]
part_1 = "LED lamp: s=2"
part_2 = "RELAY-1 relay: s=12"

[[slot]]
name = "lamp"
part = "LED"

[[slot]]
name = "relay"
part = "RELAY-1"
"""
BOOT = """\
import machine, pins
for name in dir(pins):
    if name not in dir(machine):
        setattr(machine, name, getattr(pins, name))
"""


def test_one_command_gives_the_key_of_a_generic_board_to_all_parts_that_are_wired_to_it(tmp_path: Path) -> None:
    (tmp_path / "robot.toml").write_text(KEYS)
    assert run("apply", "--yes", cwd=tmp_path).returncode == 0
    new = run("key", "new", "BOARD-8", "--no-qr", cwd=tmp_path).stdout
    uid, key = (found[1] for word in ("UID", "key  ") if (found := re.search(rf"{word} +([0-9a-f-]+)", new)))
    assert len(run("key", "board", uid, cwd=tmp_path).stdout.splitlines()) == 2
    line = tmp_path / "uart"
    files = {
        "/msbot.json": json.dumps({"link": "serial:1", "uid": uid, "key": key.replace("-", "")}),
        "/pins.py": PINS.read_text(),
        "/boot.py": BOOT,
        "/main.py": 'import msbot\nmsbot.run_board(local_name="front board")\n',
    }
    with ExitStack() as stack:
        master = stack.enter_context(running("master", "--no-page", "--link", f"pty:{line}", cwd=tmp_path))
        master.wait_for("is up on")
        board = stack.enter_context(simulated_board(uart=str(line.resolve()), lib=str(micro.FOLDER), files=files))
        active = {master.wait_for("-> active in slot").partition(":")[0] for _ in range(3)}
        assert active == {"front board", "lamp", "relay"}
        again = run("board", "reset", "--port", board.port)
        assert (again.returncode, again.stderr) == (0, "")


def test_a_board_joins_publishes_is_listed_and_leaves_by_ctrl_c(tmp_path: Path) -> None:
    (tmp_path / "my_part.py").write_text(PROGRAM)
    assert run("init", cwd=tmp_path).returncode == 0
    line = tmp_path / "uart"
    with ExitStack() as stack:
        udp = f"udp:127.0.0.1:{free_port()}"
        links = ("--link", f"pty:{line}", "--link", udp)
        master = stack.enter_context(running("master", "--no-page", *links, cwd=tmp_path))
        master.wait_for("is up on", udp)
        board = stack.enter_context(simulated_board(uart=str(line.resolve()), lib=str(micro.FOLDER)))
        command = ("board", "run", "my_part.py", "--source", "--port", board.port, "--link", "serial:1")
        started_at = time.monotonic()
        part = stack.enter_context(running(*command, cwd=tmp_path))
        part.wait_for("# ABCD-local is active: in slot AA")
        print(f"active after {time.monotonic() - started_at:.1f} s")
        lamp = stack.enter_context(
            running("part", "BB", "--link", udp, cwd=tmp_path, env={"XDG_STATE_HOME": str(tmp_path / "state")})
        )
        lamp.wait_for("output", "on")
        wait_for_states({"AA": "active", "BB": "active"}, cwd=tmp_path)
        assert part.end(signal.SIGINT) == 0
        assert part.lines[-1] == "# ABCD-local has ended"
        master.wait_for("AA", "left")
        again = run("board", "reset", "--port", board.port)
        assert (again.returncode, again.stderr) == (0, "")
