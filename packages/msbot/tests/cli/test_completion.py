"""`msbot completion`: what the shells are given works."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import threading
from pathlib import Path

import pytest
from click.shell_completion import BashComplete

from msbot.cli import completers
from msbot.cli.completers import in_time
from msbot.config import SAMPLES, load_library, parse_blueprint
from msbot.registry import open_registry
from msbot_agent.cli import COMMANDS, msbot

MSBOT = str(Path(sys.executable).with_name("msbot"))


def run(*arguments: str, **variables: str) -> str:
    environment = os.environ | variables
    done = subprocess.run(arguments, capture_output=True, text=True, check=False, env=environment)
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.mark.parametrize(
    ("words", "wanted"),
    [
        ("msbot se", {"set", "service"}),
        ("msbot ", set(COMMANDS)),
        ("msbot library s", {"search", "show"}),
        ("msbot parts --js", {"--json"}),
    ],
)
def test_commands_and_options_are_completed(words: str, wanted: set[str]) -> None:
    number = str(words.count(" "))
    lines = run(MSBOT, _MSBOT_COMPLETE="bash_complete", COMP_WORDS=words, COMP_CWORD=number).splitlines()
    assert {line.partition(",")[2] for line in lines} == wanted


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_a_shell_takes_its_script(shell: str, tmp_path: Path) -> None:
    script = run(MSBOT, "completion", shell)
    assert script.startswith(("# Put into", "# Once"))
    if shutil.which(shell) is None:
        pytest.skip(f"{shell} is not installed")
    (tmp_path / "script").write_text(script)
    run(shell, "-n", str(tmp_path / "script"))


@pytest.fixture
def robot(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with the rover's database and a recording."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path / "none"))
    library = load_library()
    with open_registry("robot.db") as registry:
        registry.robots.apply_blueprint(parse_blueprint(SAMPLES["rover"], library), library)
    (tmp_path / "lesson.mcap").write_bytes(b"")
    (tmp_path / "notes.txt").write_bytes(b"")
    return tmp_path


ROBOT_WORDS = [
    ("msbot set fa", {"fan"}),
    ("msbot set fan st", {"start_at"}),
    ("msbot parts --slot kn", {"knob"}),
    ("msbot parts --robot RO", {"ROVER"}),
    ("msbot swap knob --to fa", {"fan"}),
    ("msbot topic echo fan", {"fan_power"}),
    ("msbot publish fan.", {"fan.power"}),
    ("msbot library show BUT", {"BUTTON"}),
    ("msbot part BUT", {"BUTTON"}),
    ("msbot fault add reord", {"reordering"}),
    ("msbot log show les", {"lesson.mcap"}),
    ("msbot why zz", set()),
]


@pytest.mark.parametrize(("words", "wanted"), ROBOT_WORDS)
def test_names_of_the_robot_are_completed(words: str, wanted: set[str], robot: Path) -> None:
    assert robot.exists()
    assert completed(words) == wanted


@pytest.mark.parametrize(
    ("words", "wanted"),
    [
        ("set --db {} fa", {"fan"}),
        ("set --db {} fan st", {"start_at"}),
        ("parts --db {} --robot RO", {"ROVER"}),
        ("topic echo --db {} fan", {"fan_power"}),
        ("publish --db {} fan.", {"fan.power"}),
    ],
)
def test_a_database_that_is_no_file_has_the_same_names(
    words: str, wanted: set[str], robot: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As at PostgreSQL: through the registry."""
    monkeypatch.setattr(completers, "PATIENCE_SERVER_S", 60.0)
    assert completed(f"msbot {words.format(f'sqlite:///{robot}/robot.db')}") == wanted
    assert completed(f"msbot {words.format('postgresql://nobody@127.0.0.1:1/none')}") == set()


def completed(words: str) -> set[str]:
    *before, incomplete = words.split(" ")[1:]
    return {one.value for one in BashComplete(msbot, {}, "msbot", "_").get_completions(before, incomplete)}


@pytest.mark.parametrize("damage", ["no database", "text", "folder"])
def test_where_nothing_can_be_found_nothing_is_said(damage: str, robot: Path) -> None:
    database = robot / "robot.db"
    database.unlink()
    if damage == "text":
        database.write_text("no database at all" * 100)
    elif damage == "folder":
        database.mkdir()
    assert completed("msbot set ") == set()


def test_a_shell_never_sees_what_is_wrong(robot: Path) -> None:
    (robot / "robot.db").write_text("no database at all")
    environment = os.environ | {"_MSBOT_COMPLETE": "bash_complete", "COMP_WORDS": "msbot set ", "COMP_CWORD": "2"}
    for variables in ({}, {"COMP_CWORD": "two"}):
        done = subprocess.run([MSBOT], capture_output=True, text=True, check=False, env=environment | variables)
        assert (done.returncode, done.stdout.strip(), done.stderr) == (0, "", "")


def test_names_that_take_too_long_are_not_waited_for() -> None:
    never = threading.Event()

    def find() -> list[str]:
        never.wait()
        return ["fan"]

    assert in_time(find, "") == []
    never.set()


def test_names_that_a_shell_would_take_for_something_else_are_left_out() -> None:
    odd = ["two words", "$(reboot)", "a;b", "*", "", "new\nline", "fan", "灯", "x" * 200]
    assert [one.value for one in in_time(lambda: odd, "")] == ["fan", "灯"]


def test_bash_itself_completes_a_slot(robot: Path) -> None:
    if shutil.which("bash") is None:
        pytest.skip("bash is not installed")
    script = (
        f'eval "$({MSBOT} completion bash)"; PATH={Path(MSBOT).parent}:$PATH; COMP_WORDS=(msbot set fa); COMP_CWORD=2; '
        '_msbot_completion msbot; echo "${COMPREPLY[@]}"'
    )
    assert (run("bash", "-c", script).strip(), robot.exists()) == ("fan", True)


def test_fish_itself_completes_a_slot(robot: Path) -> None:
    if shutil.which("fish") is None:
        pytest.skip("fish is not installed")
    script = f'set -x PATH {Path(MSBOT).parent} $PATH; {MSBOT} completion fish | source; complete -C "msbot set fa"'
    assert (run("fish", "-c", script, HOME=str(robot)).strip(), robot.exists()) == ("fan", True)


def test_zsh_itself_completes_a_slot(robot: Path) -> None:
    """In zsh a completion function works in its editor only: here what it gives to it is looked at."""
    if shutil.which("zsh") is None:
        pytest.skip("zsh is not installed")
    script = (
        f"PATH={Path(MSBOT).parent}:$PATH; compdef() {{ }}; compadd() {{ print -r -- $completions }}; "
        f'_describe() {{ print -r -- $completions_with_descriptions }}; eval "$({MSBOT} completion zsh)"; '
        "words=(msbot set fa); CURRENT=3; _msbot_completion"
    )
    assert "fan" in run("zsh", "-f", "-c", script).split()
    assert robot.exists()
