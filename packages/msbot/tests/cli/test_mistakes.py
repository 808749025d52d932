"""Names and numbers on the command line that cannot be used: one sentence and status 2, never a traceback."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import click
import pytest
from click.testing import CliRunner

from msbot.cli.db import command as db
from msbot.cli.key import command as key
from msbot.registry import open_registry
from msbot_agent.cli.agent.agent import port_names
from msbot_agent.cli.agent.serving import LARGEST_FILE, read_references
from msbot_agent.cli.group import LONGEST_NAME, LazyGroup, printable_name, run
from msbot_agent.cli.options import FiniteRange, WholeRange
from msbot_school.lessons.lesson_reader import read_lesson
from msbot_school.missions.mission_file import load_mission
from msbot_xrce.errors import ConfigError, RegistryError


def answer(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, error: BaseException) -> str:
    """What is said when a command fails with this error."""

    def fail(*_: object, **__: object) -> None:
        raise error

    monkeypatch.setattr(LazyGroup, "__call__", fail)
    with pytest.raises(SystemExit) as ended:
        run()
    assert ended.value.code == 2
    return capsys.readouterr().err


@pytest.mark.parametrize("has_pip", [True, False])
def test_where_there_is_no_pip_the_advice_says_what_takes_its_place(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, *, has_pip: bool
) -> None:
    monkeypatch.setattr("msbot_agent.cli.group.find_spec", lambda _: object() if has_pip else None)
    said = answer(capsys, monkeypatch, ConfigError("a world needs pymunk: pip install 'msbot[arena]'"))
    assert said.startswith("msbot: a world needs pymunk: pip install 'msbot[arena]'\n")
    assert (f" -m pip --python {sys.executable}`\n" in said) is not has_pip


def test_a_file_that_cannot_be_looked_at_is_named(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    said = answer(capsys, monkeypatch, PermissionError(13, "Permission denied", "/home/ada/robot.db"))
    assert said == "msbot: /home/ada/robot.db: Permission denied\n"


def test_a_name_that_is_too_long_is_said_in_short(tmp_path: Path) -> None:
    name = "x" * 5000
    done = subprocess.run(
        [sys.executable, "-m", "msbot", "export", "--db", name],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 2
    assert done.stderr == f"msbot: {'x' * LONGEST_NAME}... (5000 letters): File name too long\n"


def test_a_name_that_is_no_utf8_is_said(tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-m", "msbot", "library", "search", b"caf\xe9"],
        env={**os.environ, "PYTHONIOENCODING": "utf-8"},
        cwd=tmp_path,
        capture_output=True,
        check=False,
    )
    assert done.returncode == 2
    assert done.stderr == b"msbot: caf? is not UTF-8, as names and texts must be\n"


def test_what_no_user_has_caused_is_not_hidden(monkeypatch: pytest.MonkeyPatch) -> None:
    for error in (OSError(5, "Input/output error"), UnicodeEncodeError("ascii", "\xe9", 0, 1, "range")):

        def fail(*_: object, error: Exception = error, **__: object) -> None:
            raise error

        monkeypatch.setattr(LazyGroup, "__call__", fail)
        with pytest.raises(type(error)):
            run()


@pytest.mark.parametrize(
    ("name", "words"),
    [("a\x1b[2Jb", "a?[2Jb"), (b"caf\xe9", "caf?"), (Path("robot.db"), "robot.db"), (7, "7")],
)
def test_a_name_in_a_sentence_can_be_printed_anywhere(name: object, words: str) -> None:
    assert printable_name(name) == words


@pytest.mark.parametrize("number", ["nan", "inf", "-inf", "1e400"])
def test_a_number_that_is_none_is_refused(number: str) -> None:
    with pytest.raises(click.BadParameter):
        FiniteRange(min=-1.0).convert(float(number), None, None)
    assert FiniteRange(min=-1.0).convert(2.5, None, None) == 2.5


@pytest.mark.parametrize(
    ("kind", "value", "words"),
    [
        (WholeRange(0, 65535), "web", "'web' is not a whole number from 0 to 65535"),
        (WholeRange(0, 65535), "65536", "'65536' is not a whole number from 0 to 65535"),
        (WholeRange(0, 65535), -1, "'-1' is not a whole number from 0 to 65535"),
        (WholeRange(min=1), "0", "'0' is not a whole number of 1 or more"),
        (WholeRange(max=9), "10", "'10' is not a whole number of 9 or less"),
        (WholeRange(), "1.5", "'1.5' is not a whole number"),
        (WholeRange(), "8_8", "'8_8' is not a whole number"),
        (WholeRange(), "\u0663", "'\u0663' is not a whole number"),
        (WholeRange(), "9" * 5000, f"'{'9' * LONGEST_NAME}... (5000 letters)' is not a whole number"),
        (FiniteRange(0.1, 3600), "soon", "'soon' is not a number from 0.1 to 3600"),
        (FiniteRange(0.1, 3600), "nan", "'nan' is not a number from 0.1 to 3600"),
        (FiniteRange(min=0), "-0.5", "'-0.5' is not a number of 0 or more"),
        (FiniteRange(max=1), "1.5", "'1.5' is not a number of 1 or less"),
        (FiniteRange(), "x\n", "'x?' is not a number"),
    ],
)
def test_a_number_that_cannot_be_used_says_what_would_be_right(
    kind: WholeRange | FiniteRange, value: object, words: str
) -> None:
    with pytest.raises(click.BadParameter) as refused:
        kind.convert(value, None, None)
    assert refused.value.message == words


def test_numbers_that_can_be_used() -> None:
    ports, seconds = WholeRange(0, 65535), FiniteRange(0.1, 3600)
    assert [ports.convert(one, None, None) for one in ("0", " 65535 ", "+7", 12)] == [0, 65535, 7, 12]
    assert [seconds.convert(one, None, None) for one in ("0.1", "3600", "1e3", 2.5)] == [0.1, 3600.0, 1000.0, 2.5]
    assert WholeRange().convert("-5", None, None) == -5
    assert FiniteRange().convert("-1e9", None, None) == -1e9


def test_a_serial_port_is_named_once() -> None:
    assert port_names(("/dev/a /dev/b", "/dev/c"), None) == ["/dev/a", "/dev/b", "/dev/c"]
    with pytest.raises(ConfigError, match=r"^/dev/a: a serial port is opened once"):
        port_names(("/dev/a,/dev/b", "/dev/a"), None)


def test_every_port_and_one_more_is_a_contradiction() -> None:
    assert port_names(("auto",), None) == ["auto"]
    with pytest.raises(ConfigError, match=r"^--dev auto takes every serial port: name no other beside it$"):
        port_names(("auto", "/dev/ttyUSB0"), None)


def test_a_file_with_the_names_of_ports_says_why_it_cannot_be_read(tmp_path: Path) -> None:
    missing = tmp_path / "ports"
    with pytest.raises(ConfigError) as refused:
        port_names((), missing)
    assert str(refused.value) == f"cannot read the names of serial ports in {missing}: No such file or directory"
    missing.write_text("/dev/a\n/dev/b\n")
    assert port_names((), missing) == ["/dev/a", "/dev/b"]


@pytest.mark.skipif(not os.path.exists("/dev/zero"), reason="there is no /dev/zero here")
def test_profiles_without_an_end_are_not_read_to_the_end() -> None:
    with pytest.raises(ConfigError, match=f"/dev/zero is larger than {LARGEST_FILE:,} characters"):
        read_references(Path("/dev/zero"))
    with pytest.raises(ConfigError, match=f"/dev/zero is larger than {LARGEST_FILE:,} characters"):
        port_names((), Path("/dev/zero"))


def test_a_backup_into_a_folder_that_is_not_there_names_the_folder(tmp_path: Path) -> None:
    database, folder = tmp_path / "robot.db", tmp_path / "old ones"
    open_registry(str(database)).close()
    result = CliRunner().invoke(db, ["backup", str(folder / "a.db"), "--db", str(database)])
    assert isinstance(result.exception, ConfigError)
    assert str(result.exception) == (
        f"{folder}/a.db: there is no folder {folder}; create it with `mkdir -p '{folder}'`"
    )


@pytest.mark.skipif(not os.path.exists("/dev/zero"), reason="there is no /dev/zero here")
def test_missions_and_lessons_without_an_end_are_not_read_to_the_end() -> None:
    with pytest.raises(ConfigError, match="/dev/zero: is larger than 256,000 bytes"):
        load_mission(Path("/dev/zero"))
    with pytest.raises(ConfigError, match="/dev/zero: a lesson has at most 256000 bytes"):
        read_lesson(Path("/dev/zero"))


@pytest.mark.parametrize("number", ["", " ", "a\nb"])
def test_a_key_is_for_a_part_number(number: str, tmp_path: Path) -> None:
    database = tmp_path / "robot.db"
    open_registry(str(database)).close()
    result = CliRunner().invoke(key, ["new", number, "--db", str(database)])
    assert isinstance(result.exception, ConfigError)
    assert "is no part number" in str(result.exception)
    assert result.output == ""


def test_nobody_is_asked_about_a_backup_that_is_not_there(tmp_path: Path) -> None:
    result = CliRunner().invoke(db, ["restore", str(tmp_path / "none.db")], input="y\n")
    assert isinstance(result.exception, RegistryError)
    assert "there is no backup" in str(result.exception)
    assert result.output == ""


def told(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, *words: str) -> str:
    """What `msbot` says on standard error of a command line that it refuses."""
    monkeypatch.setattr(sys, "argv", ["msbot", *words])
    with pytest.raises(SystemExit) as ended:
        run()
    assert ended.value.code == 2
    return capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("--bogus", "No such option '--bogus'. Try `msbot --help`."),
        ("bus decod", "No such command 'decod'. Did you mean 'decode'? Try `msbot bus --help`."),
        ("bus selftest x", "Got unexpected extra argument (x). Try `msbot bus selftest --help`."),
        ("part", "Missing argument 'NAME'. Try `msbot part --help`."),
        (
            "demo --port web",
            "Invalid value for '--port': 'web' is not a whole number from 0 to 65535. Try `msbot demo --help`.",
        ),
        ("demo --json", "--json prints at the end: say when with --seconds N. Try `msbot demo --help`."),
        (
            "demo --rec 5",
            'Invalid value for \'--rec\': \'5\': say how much to keep ("10min", "2h", "500MB", "30min,500MB"), a '
            'file ("lesson.mcap", "bag.mcap,ros2"), or "off". Try `msbot demo --help`.',
        ),
    ],
)
def test_a_wrong_command_line_is_one_line_as_every_mistake_is(
    words: str, said: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    assert told(capsys, monkeypatch, *words.split()) == f"msbot: {said}\n"


def test_a_group_without_a_command_lists_its_commands(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    assert told(capsys, monkeypatch, "bus").startswith("Usage: msbot bus [OPTIONS] COMMAND [ARGS]...\n\n  Tools for")


@pytest.mark.parametrize(
    ("variable", "words"),
    [("MSBOT_REC", "demo"), ("MSBOT_LINK", "part BUTTON"), ("MSBOT_LINK", "host"), ("MSBOT_LINK", "play x.mcap")],
)
def test_a_wrong_environment_variable_is_told_by_its_name(
    variable: str, words: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(variable, "bogus")
    said = told(capsys, monkeypatch, *words.split())
    assert said.startswith(f"msbot: Invalid value for the environment variable {variable}: ")
    assert "bogus" in said
    assert "--rec" not in said
    assert "--link" not in said
    if variable == "MSBOT_LINK":
        assert told(capsys, monkeypatch, *words.split(), "--link", "nope").startswith(
            "msbot: Invalid value for '--link': link 'nope': unknown kind"
        )


@pytest.mark.parametrize("words", ["part BUTTON --uid zz", "part AA --uid zz", "part BUTTON --key zz"])
def test_what_is_wrong_with_a_part_is_told_as_everything_is(
    words: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    said = told(capsys, monkeypatch, *words.split())
    assert said.startswith("msbot: ")
    assert said.count("\n") == 1


def test_what_is_broken_off_says_so(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    def broken_off(*_: object, **__: object) -> None:
        raise click.Abort

    monkeypatch.setattr(LazyGroup, "__call__", broken_off)
    with pytest.raises(SystemExit) as ended:
        run()
    assert ended.value.code == 1
    assert capsys.readouterr().err == "msbot: broken off before it was done\n"


def test_a_mission_that_is_no_text_is_told_as_a_lesson_is(tmp_path: Path) -> None:
    path = tmp_path / "mission.toml"
    path.write_bytes(b"\xff\xfe")
    with pytest.raises(ConfigError, match=r"mission\.toml: is no text in UTF-8; save it as UTF-8$"):
        load_mission(path)
