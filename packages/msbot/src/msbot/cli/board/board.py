"""`msbot board`: boards with MicroPython at a serial port of this computer."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO

import click

from msbot.cli.board.ports import NEEDED, choose, ports
from msbot_agent.cli.options import json_option
from msbot_agent.text.given_file import read_given
from msbot_xrce.common.amount import amount
from msbot_xrce.errors import ConfigError

if TYPE_CHECKING:
    from msbot.cli.board.connection import Board, Facts
    from msbot.cli.board.installing import Plan

WIFI_PASSWORD = "MSBOT_WIFI_PASSWORD"
TOKEN = "MSBOT_TOKEN"
RESERVED = ("boot.py", "main.py")
"""Files that a board runs by itself: a program has another name on it."""
MOST_OCTETS = 1_000_000
"""Of a program; the memory of most boards is smaller."""

port_option = click.option("--port", metavar="PORT", help="The board's serial port; the only one at USB if absent.")
link_option = click.option(
    "--link",
    metavar="ADDRESS",
    help="The board's way to the master, kept on it: serial:1?tx=4&rx=5, udp:HOST:PORT, ...",
)
wifi_option = click.option(
    "--wifi", metavar="NAME", help=f"The Wi-Fi that it joins; asks for the password, unless ${WIFI_PASSWORD} has it."
)
source_option = click.option("--source", is_flag=True, help="Install sources where compiled files could be installed.")


@click.group("board")
def command() -> None:
    """Boards with MicroPython at a serial port: install MsBOT, run programs, open a prompt."""


@command.command("list")
@json_option
def list_command(*, as_json: bool) -> None:
    """List the serial ports of this computer; boards are at those of USB."""
    found = ports()
    if as_json:
        click.echo(json.dumps([asdict(port) for port in found]))
        return
    for port in found:
        name = port.name or ("a USB device without a name" if port.usb else "not USB")
        click.echo(f"{port.port}  {name}" + (f" ({port.usb})" if port.usb else ""))
    if not found:
        click.echo("There is no serial port: plug a board in, with a cable that carries data.")


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
    """Put MsBOT's package on a board; with FILE also this program, which then runs whenever the board starts."""
    program = None if file is None else _Program(file)
    with _prepared(program, port, link, wifi, source=source, is_quiet=as_json) as ready:
        if program is not None:
            from msbot.cli.board.installing import MAIN

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
    """Run a program on a board at once and show what it says; Ctrl-C ends it.

    What the program needs is put on the board first. What the board runs when it starts stays as it is.
    """
    from msbot.cli.board.program_errors import error_sentence

    program = _Program(file)
    out = _terminal()
    with _prepared(program, port, link, wifi, source=source, is_quiet=False) as ready:
        if program.is_part:
            ready.check_way()
        ready.put({program.name: program.octets})
        with _interruptible():
            traceback = ready.board.run(program.starter.decode(), out)
    if traceback and (sentence := error_sentence(traceback, program.name)):
        click.echo(f"msbot: {sentence}", err=True)
        sys.exit(1)


@command.command("shell")
@port_option
def shell_command(port: str | None) -> None:
    """Open the prompt of a board (>>>); Ctrl-X leaves it, Ctrl-C ends its program, Ctrl-D starts it again."""
    from msbot.cli.board.connection import check_port

    if not sys.stdin.isatty():
        raise ConfigError("a prompt needs a terminal; to run a program: msbot board run FILE")
    where = _port(port)
    check_port(where)
    sys.exit(subprocess.call([sys.executable, "-m", "mpremote", "connect", where, "repl"]))


@command.command("reset")
@port_option
@click.option("--hard", is_flag=True, help="Reset the whole board, not only its Python.")
def reset_command(port: str | None, *, hard: bool) -> None:
    """End what runs on a board and start it again, with its main.py."""
    from msbot.cli.board.connection import open_board

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
            self.octets = read_given(file, MOST_OCTETS, "a program")
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

    def __init__(self, board: Board, facts: Facts, *, is_quiet: bool) -> None:
        self.board = board
        self.facts = facts
        self._is_quiet = is_quiet
        self._written: list[str] = []
        self._octets = 0

    def install(self, program: _Program | None, *, source: bool) -> None:
        """Put the package on it as far as the program needs it, where it is not there yet; all of it without one."""
        from msbot.cli.board.installing import plan_package

        generic = program is None or program.is_generic_board
        self._carry_out(plan_package(self.board, self.facts, source=source, generic=generic))

    def put(self, files: dict[str, bytes]) -> None:
        """Put files beside each other into the folder of programs."""
        from msbot.cli.board.installing import plan_files

        self._carry_out(plan_files(self.board, self.facts, files))

    def check_way(self) -> None:
        """Raise ConfigError if the board has not been told its way to the master."""
        from msbot.cli.board.installing import SETTINGS

        if SETTINGS not in self.board.files(self.facts.home or "/"):
            raise ConfigError(
                "the board does not know its way to the master yet: give it once with --link, for example "
                "--link 'serial:1?tx=4&rx=5' or --link udp:192.168.1.20:8888 with --wifi NAME"
            )

    def _carry_out(self, plan: Plan) -> None:
        from msbot.cli.board.installing import carry_out

        with _bar(plan.octets, is_quiet=self._is_quiet) as progress:
            carry_out(self.board, self.facts, plan, progress)
        self._written += plan.write
        self._octets += plan.octets

    def words(self) -> str:
        """What was done, for a person."""
        done = (
            f"{amount(len(self._written), 'file')} written, {self._octets} octets"
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
    from msbot.cli.board.connection import open_board
    from msbot.cli.board.installing import SETTINGS, check_link, settings_file

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
