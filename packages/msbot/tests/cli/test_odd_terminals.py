"""Commands that list something: where letters are missing, where nobody reads on, in a narrow terminal, in a pipe."""

from __future__ import annotations

import io
import sys
from collections.abc import Iterator
from pathlib import Path

import click
import pytest

from msbot.config import load_blueprint, load_library
from msbot.registry import open_registry
from msbot_agent.cli import msbot
from msbot_agent.cli.exit_status import ExitStatus
from msbot_agent.cli.group import run
from tests.cli.look.test_why import Counter
from tests.operations.stage import put_database

ROBOT = """
[robot]
name = "Zażółć 灯"
serial_number = "Ł1"
[[slot]]
name = "дial 灯"
part = "POT-10K"
description = "łamp → 灯"
[[slot]]
name = "fan"
part = "FAN-5V"
[[binding]]
topic = "speed 灯"
type = "Level"
from = "дial 灯.level"
to = ["fan.power"]
"""
LISTS = ("list", "kinds", "types", "status", "repairs")
NEEDS_MORE = {"bus list", "hardware list", "class find"}
"""Lists of what is on this computer or in its network, not in a file."""
ASKED = {
    "parts --all", "robots", "why fan", "set fan", "undo --list", "library show FAN-5V", "check robot.toml",
    "diff robot.toml", "export", "db check", "parts --json", "robots --json", "library list --json", "doctor",
    "help", "idl to-python --help", "--help",
}  # fmt: skip


def lists(command: click.Command, context: click.Context, name: str = "") -> Iterator[str]:
    """Every command with one of these names that needs no arguments."""
    if isinstance(command, click.Group):
        for sub in command.list_commands(context):
            below = command.get_command(context, sub)
            assert below is not None
            yield from lists(below, click.Context(below, context, sub), f"{name} {sub}".strip())
    elif name.rpartition(" ")[2] in LISTS and not any(one.required for one in command.params):
        yield name


CALLS = sorted({*lists(msbot, click.Context(msbot)), *ASKED} - NEEDS_MORE)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    made = tmp_path_factory.mktemp("odd")
    (made / "robot.toml").write_text(ROBOT, encoding="utf-8")
    put_database(made / "robot.db")
    library = load_library()
    with open_registry(str(made / "robot.db")) as registry:
        robot = registry.robots.apply_blueprint(load_blueprint(made / "robot.toml", library), library)
        Counter(registry, robot).claim("FAN-5V", uid=b"FAN-5V-1", name="łopata 灯")
    return made


@pytest.fixture(autouse=True)
def _here(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(folder)
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(folder))
    monkeypatch.setenv("HOME", str(folder))


class Gone(io.RawIOBase):
    """A pipe whose reader has ended."""

    def writable(self) -> bool:
        return True

    def write(self, _: object) -> int:
        raise BrokenPipeError(32, "Broken pipe")


def status_of(call: str, out: io.TextIOWrapper, monkeypatch: pytest.MonkeyPatch) -> int:
    monkeypatch.setattr(sys, "argv", ["msbot", *call.split()])
    monkeypatch.setattr(sys, "stdout", out)
    error = io.TextIOWrapper(io.BytesIO(), out.encoding, errors="backslashreplace")
    monkeypatch.setattr(sys, "stderr", error)
    with pytest.raises(SystemExit) as ended:
        run()
    out.flush()
    return int(ended.value.code or 0)


@pytest.mark.parametrize("call", CALLS)
@pytest.mark.parametrize("encoding", ["cp1252", "ascii"])
def test_letters_that_a_terminal_has_not_become_question_marks(
    call: str, encoding: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    octets = io.BytesIO()
    assert status_of(call, io.TextIOWrapper(octets, encoding), monkeypatch) in (0, 1, 2)
    if encoding == "cp1252" and call == "parts --all":
        assert b"opata ?" in octets.getvalue()


@pytest.mark.parametrize("call", ["library list", "parts --all", "robots", "why fan", "export", "mission list", "help"])
def test_a_reader_that_has_ended_is_status_1_without_a_word(call: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "argv", ["msbot", *call.split()])
    monkeypatch.setattr(sys, "stdout", io.TextIOWrapper(io.BufferedWriter(Gone()), "utf-8"))
    error = io.TextIOWrapper(io.BytesIO(), "utf-8")
    monkeypatch.setattr(sys, "stderr", error)
    with pytest.raises(SystemExit) as ended:
        run()
    assert ended.value.code == ExitStatus.NO


class Terminal(io.TextIOWrapper):
    """A terminal of 100 columns."""

    def isatty(self) -> bool:
        return True


@pytest.mark.parametrize("call", sorted({*lists(msbot, click.Context(msbot)), "parts --all", "robots"} - NEEDS_MORE))
def test_in_a_terminal_of_100_columns_no_line_is_longer(call: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "100")
    octets = io.BytesIO()
    status_of(call, Terminal(octets, "utf-8"), monkeypatch)
    assert [line for line in octets.getvalue().decode().splitlines() if len(line) > 100] == []


@pytest.mark.parametrize("call", ["library list", "parts --all", "robots", "mission list"])
def test_in_a_pipe_a_row_is_one_line_without_boxes(call: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "40")
    octets = io.BytesIO()
    status_of(call, io.TextIOWrapper(octets, "utf-8"), monkeypatch)
    text = octets.getvalue().decode()
    assert not set(text) & set("│┃─━┏┗")
    assert max(map(len, text.splitlines())) > 40
