"""`msbot board`: boards with MicroPython at a serial port of this computer."""

from __future__ import annotations

import hashlib
import json
import os
import re
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import asdict, field
from pathlib import Path
from typing import BinaryIO

import click

from msbot.carried.carried_files import FOLDER, OF_GENERIC_BOARDS, package_files
from msbot.cli.board.board_connection import NEEDED, Board, BoardFacts, BoardFile, choose, ports
from msbot_agent.cli.exit_status import ExitStatus
from msbot_agent.cli.options import json_option
from msbot_agent.cli.table import print_table
from msbot_agent.text.untrusted_input import read_input_file, read_json
from msbot_xrce.counting import amount
from msbot_xrce.errors import ConfigError
from msbot_xrce.lazy import dataclass

WIFI_PASSWORD = "MSBOT_WIFI_PASSWORD"
TOKEN = "MSBOT_TOKEN"
RESERVED = ("boot.py", "main.py")
"""Files that a board runs by itself: a program has another name on it."""
MOST_OCTETS = 1_000_000
"""Of a program; the memory of most boards is smaller."""

port_option = click.option("--port", metavar="PORT", help="The board's serial port; default: the only USB one.")
link_option = click.option(
    "--link",
    metavar="ADDRESS",
    help="How the board reaches the master, stored on it: serial:1?tx=4&rx=5, udp:HOST:PORT, ...",
)
wifi_option = click.option(
    "--wifi", metavar="NAME", help=f"The Wi-Fi that it joins; asks for the password, unless ${WIFI_PASSWORD} has it."
)
source_option = click.option("--source", is_flag=True, help="Install sources even where compiled files could be used.")


@click.group("board")
def command() -> None:
    """Boards with MicroPython at a serial port: install MsBOT, run programs, open a prompt."""


@command.command("list")
@json_option
def list_command(*, as_json: bool) -> None:
    """List the serial ports, USB first."""
    found = ports()
    if as_json:
        click.echo(json.dumps([asdict(port) for port in found]))
        return
    if not found:
        click.echo("There is no serial port: plug a board in, with a cable that carries data.")
        return
    nameless = {True: "a USB device without a name", False: "not USB"}
    print_table(
        ("port", "USB", "device"),
        [(port.port, port.usb or "-", port.name or nameless[bool(port.usb)]) for port in found],
    )


@command.command("install")
@click.argument("file", required=False, type=click.Path(path_type=Path))
@port_option
@link_option
@wifi_option
@source_option
@json_option
def install_command(
    file: Path | None, port: str | None, link: str | None, wifi: str | None, *, source: bool, as_json: bool
) -> None:
    """Install MsBOT on a board; with FILE also this program, which then runs at each start."""
    program = None if file is None else _Program(file)
    with _prepared(program, port, link, wifi, source=source, is_quiet=as_json) as ready:
        if program is not None:
            ready.put({program.name: program.octets, MAIN: program.starter})
            ready.board.restart()
    if as_json:
        click.echo(json.dumps(ready.report(program)))
        return
    click.echo(ready.words())
    if program is not None:
        click.echo(f"{file} runs now, and whenever the board starts. What it says: msbot board shell")


@command.command("run")
@click.argument("file", type=click.Path(path_type=Path))
@port_option
@link_option
@wifi_option
@source_option
def run_command(file: Path, port: str | None, link: str | None, wifi: str | None, *, source: bool) -> None:
    """Install what is missing, run FILE once on a board and show its output; Ctrl-C ends it.

    What the board runs when it starts does not change.
    """

    program = _Program(file)
    out = _terminal()
    with _prepared(program, port, link, wifi, source=source, is_quiet=False) as ready:
        if program.is_part:
            ready.check_way()
        ready.put({program.name: program.octets})
        with _interruptible():
            traceback = ready.board.run(program.starter.decode(), out)
    if traceback and (sentence := error_sentence(traceback, program.name)):
        if not sentence.endswith(TOLD):
            click.echo(f"msbot: {sentence}", err=True)
        sys.exit(ExitStatus.NO)


@command.command("shell")
@port_option
def shell_command(port: str | None) -> None:
    """Open the prompt of a board (>>>); Ctrl-X leaves it, Ctrl-C ends its program, Ctrl-D starts it again."""
    from msbot.cli.board.board_connection import check_port

    if not sys.stdin.isatty():
        raise ConfigError("a prompt needs a terminal; to run a program: msbot board run FILE")
    where = _port(port)
    check_port(where)
    sys.exit(subprocess.call([sys.executable, "-m", "mpremote", "connect", where, "repl"]))


@command.command("reset")
@port_option
@click.option("--hard", is_flag=True, help="Reset the whole board, not only its Python.")
def reset_command(port: str | None, *, hard: bool) -> None:
    """Restart the board's Python and its start program."""
    from msbot.cli.board.board_connection import open_board

    with open_board(_port(port)) as board:
        if hard:
            board.reset()
        else:
            board.restart()
    click.echo(f"The board at {board.port} has started again. What it says: msbot board shell")


class _Program:
    """A program of a person: read, and looked through for mistakes that need no board."""

    def __init__(self, file: Path) -> None:
        try:
            self.octets = read_input_file(file, MOST_OCTETS, "a program")
        except OSError as error:
            raise ConfigError(f"{file} cannot be read: {error.strerror}") from None
        try:
            text = self.octets.decode("utf-8")
            compile(text, str(file), "exec", dont_inherit=True)
        except UnicodeDecodeError:
            raise ConfigError(f"{file} is no text in UTF-8: a program is a .py file") from None
        except (SyntaxError, ValueError) as error:
            line = error.lineno if isinstance(error, SyntaxError) else None
            words = error.msg if isinstance(error, SyntaxError) else str(error)
            raise ConfigError(f"{file}, line {line or 1}: {words}") from None
        self.name = f"my_{file.name}" if file.name in RESERVED else file.name
        self.is_part = "msbot" in text
        self.is_generic_board = "run_board" in text or "GenericBoard" in text

    @property
    def starter(self) -> bytes:
        """What starts it on the board: also a `main.py`."""
        return f'import msbot\n\nmsbot.start("{self.name}")\n'.encode()


class _Ready:
    """A board with MsBOT's package and its settings on it."""

    def __init__(self, board: Board, facts: BoardFacts, *, is_quiet: bool) -> None:
        self.board = board
        self.facts = facts
        self._is_quiet = is_quiet
        self._written: list[str] = []
        self._octets = 0

    def install(self, program: _Program | None, *, source: bool) -> None:
        """Put the package on it as far as the program needs it, where it is not there yet; all of it without one."""

        generic = program is None or program.is_generic_board
        self._carry_out(plan_package(self.board, self.facts, source=source, generic=generic))

    def put(self, files: dict[str, bytes]) -> None:
        """Put files beside each other into the folder of programs."""

        self._carry_out(plan_files(self.board, self.facts, files))

    def check_way(self) -> None:
        """Raise ConfigError if the board has not been told its way to the master."""

        if SETTINGS not in self.board.files(self.facts.home or "/"):
            raise ConfigError(
                "the board does not know its way to the master yet: give it once with --link, for example "
                "--link 'serial:1?tx=4&rx=5' or --link udp:192.168.1.20:8888 with --wifi NAME"
            )

    def _carry_out(self, plan: Plan) -> None:

        with _bar(plan.octets, is_quiet=self._is_quiet) as progress:
            carry_out(self.board, self.facts, plan, progress)
        self._written += plan.write
        self._octets += plan.octets

    def words(self) -> str:
        """What was done, for a person."""
        done = (
            f"{amount(len(self._written), 'file')} written, {self._octets} bytes"
            if self._written
            else "all was there already"
        )
        return f"MsBOT is on the board at {self.board.port} ({self.facts.machine}): {done}."

    def report(self, program: _Program | None) -> dict[str, object]:
        """The same for a program."""
        return {
            "port": self.board.port,
            "machine": self.facts.machine,
            "micropython": self.facts.version_words,
            "written": self._written,
            "octets": self._octets,
            "runs": None if program is None else program.name,
        }


@contextmanager
def _prepared(
    program: _Program | None, port: str | None, link: str | None, wifi: str | None, *, source: bool, is_quiet: bool
) -> Iterator[_Ready]:
    from msbot.cli.board.board_connection import open_board

    if link is not None:
        check_link(link)
    needs_token = link is not None and link.startswith("ws:")
    token = os.environ.get(TOKEN, "").strip() if needs_token else None
    if token == "":
        raise ConfigError(
            f"a board at the page needs an API token (the page's Admin, API tokens): put it into ${TOKEN}"
        )
    network = None if wifi is None else (wifi, _password(wifi))
    where = _port(port)
    with open_board(where) as board:
        ready = _Ready(board, board.facts(), is_quiet=is_quiet)
        ready.install(program, source=source)
        settings = settings_file(board, ready.facts, link=link, wifi=network, token=token)
        if settings is not None:
            ready.put({SETTINGS: settings})
        yield ready


def _port(port: str | None) -> str:
    import importlib.util

    if importlib.util.find_spec("mpremote") is None:
        raise ConfigError(NEEDED)
    return choose(port, [] if port is not None else ports())


def _password(wifi: str) -> str:
    kept = os.environ.get(WIFI_PASSWORD)
    if kept is not None:
        return kept
    if not sys.stdin.isatty():
        raise ConfigError(f"put the password of {wifi} into ${WIFI_PASSWORD}")
    answer: str = click.prompt(f"Password of {wifi}", hide_input=True, default="", show_default=False)
    return answer


@contextmanager
def _bar(octets: int, *, is_quiet: bool) -> Iterator[Callable[[int], object]]:
    """Show how far it is, on a terminal."""
    if is_quiet or not octets or not sys.stderr.isatty():
        yield lambda _: None
        return
    with click.progressbar(length=octets, label="Writing", file=sys.stderr) as bar:
        yield bar.update


def _terminal() -> Callable[[bytes], object]:
    """Writes what a board prints to standard output; boards end lines as terminals want it."""
    stream: BinaryIO = sys.stdout.buffer

    def out(octets: bytes) -> None:
        stream.write(octets.replace(b"\r", b"").replace(b"\x04", b""))
        stream.flush()

    return out


@contextmanager
def _interruptible() -> Iterator[None]:
    """SIGTERM ends the program on the board, too."""
    before = signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


# What went wrong in a program, in one sentence, from the traceback that MicroPython prints.


TOLD = "ProgramFailed: the line above says why"
"""How a traceback ends when the part itself has told its mistake (`words.fail` of `micropython`)."""
_FRAME = re.compile(r'^ *File "(?P<file>[^"]+)", line (?P<line>\d+)', re.MULTILINE)


def error_sentence(traceback: str, program: str) -> str:
    """`my_part.py, line 7: NameError: name 'x' isn't defined`; "" for a program that was interrupted.

    Args:
        traceback: as the board prints it.
        program: the file whose line a person wants to see; if no frame is in it, the innermost one is named.
    """
    lines = [line for line in traceback.replace("\r", "").split("\n") if line.strip()]
    what = lines[-1].strip() if lines else ""
    if what.partition(":")[0] == "KeyboardInterrupt":
        return ""
    frames = list(_FRAME.finditer(traceback))
    mine = [frame for frame in frames if frame["file"] == program] or frames
    return f"{mine[-1]['file']}, line {mine[-1]['line']}: {what}" if mine else f"{program}: {what or 'no reason given'}"


# Putting files on a board: only what is not there yet, and only if there is room for all of it.


SETTINGS = "msbot.json"
LINKS = ("can", "serial", "udp", "ws")
"""Kinds of links that a board has."""
MAIN = "main.py"


@dataclass(slots=True)
class Plan:
    """What there is to do."""

    write: dict[str, bytes] = field(default_factory=dict)
    remove: list[str] = field(default_factory=list)
    there: dict[str, int] = field(default_factory=dict)
    """Sizes of the files that are there and will be replaced or removed."""

    @property
    def octets(self) -> int:
        """How much is written."""
        return sum(map(len, self.write.values()))


def plan_package(board: Board, facts: BoardFacts, *, source: bool, generic: bool) -> Plan:
    """What the package needs: files that are missing or different, without those that are not part of it any more.

    Args:
        board: where to.
        facts: what it is.
        source: not compiled.
        generic: whether to put there what only generic boards need; what is there is kept up to date in any case.
    """
    folder = f"{facts.lib}/{FOLDER}"
    wanted = package_files(None if source else facts.mpy_version)
    there = board.files(folder)
    plan = Plan()
    for name, octets in wanted.items():
        if not generic and name not in there and name.partition(".")[0] in OF_GENERIC_BOARDS:
            continue
        _add(plan, folder, name, octets, there)
    for name in there:
        if name not in wanted:
            plan.remove.append(f"{folder}/{name}")
            plan.there[f"{folder}/{name}"] = there[name].size
    return plan


def plan_files(board: Board, facts: BoardFacts, files: dict[str, bytes]) -> Plan:
    """What files in the folder of programs need."""
    plan = Plan()
    there = board.files(facts.home or "/")
    for name, octets in files.items():
        _add(plan, facts.home, name, octets, there)
    return plan


def _add(plan: Plan, folder: str, name: str, octets: bytes, there: dict[str, BoardFile]) -> None:
    path, known = f"{folder}/{name}", there.get(name)
    if known is not None:
        if known.sha256 == hashlib.sha256(octets).digest():
            return
        plan.there[path] = known.size
    plan.write[path] = octets


def carry_out(board: Board, facts: BoardFacts, plan: Plan, progress: Callable[[int], object]) -> None:
    """Remove and write.

    Raises:
        ConfigError: there is no room for all of it; nothing was changed.
    """
    _check_room(board, facts, plan)
    for path in plan.remove:
        board.remove(path)
    for folder in sorted({path.rpartition("/")[0] for path in plan.write} - {"", facts.home}):
        board.make_folder(folder)
    for path, octets in plan.write.items():
        board.write(path, octets, progress)


def _check_room(board: Board, facts: BoardFacts, plan: Plan) -> None:
    room = board.free_space(facts.home)
    if room is None:
        return
    free, block = room
    need = sum(_blocks(len(octets), block) for octets in plan.write.values())
    need -= sum(_blocks(size, block) for size in plan.there.values())
    if need * block > free:
        files = amount(len(plan.write), "file")
        raise ConfigError(
            f"the board at {board.port} has no space for this: {plan.octets} bytes in {files} need "
            f"{-(-need * block // 1024)} kB more than what they replace, and {free // 1024} kB are free: remove files "
            "from it (msbot board shell; import os; os.listdir())"
        )


def _blocks(size: int, block: int) -> int:
    return -(-size // block)


def settings_file(
    board: Board, facts: BoardFacts, *, link: str | None, wifi: tuple[str, str] | None, token: str | None
) -> bytes | None:
    """The board's `msbot.json` with what is given, everything else in it kept; None if it is as it should be.

    Raises:
        ConfigError: the link is none that a board has.
    """
    if link is None and wifi is None:
        return None
    known: dict[str, object] = {}
    path = f"{facts.home}/{SETTINGS}"
    if SETTINGS in board.files(facts.home or "/"):
        try:
            found = read_json(board.read(path))
            json.dumps(found, allow_nan=False)
        except (ValueError, RecursionError):  # what no board could read
            found = None
        known = found if isinstance(found, dict) else {}
    if link is not None:
        known["link"] = link
    if wifi is not None:
        known["wifi"] = list(wifi)
    if token is not None:
        known["token"] = token
    return (json.dumps(known) + "\n").encode()


def check_link(link: str) -> None:
    """Raise ConfigError if an address is none of a board."""
    kind, colon, rest = link.partition(":")
    if kind not in LINKS or not colon or not rest:
        raise ConfigError(
            f"link {link!r}: a board has can:1?bitrate=500000, serial:1?baudrate=115200&tx=4&rx=5, "
            "udp:192.168.1.20:8888 or ws://192.168.1.20:8080 (`msbot help micropython`)"
        )
