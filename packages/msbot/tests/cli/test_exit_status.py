"""How commands end: by one table, which the page of commands shows."""

from __future__ import annotations

import ast
import sys
from collections.abc import Iterator
from pathlib import Path

import click
import pytest
from click.testing import CliRunner

from msbot_agent.cli import msbot
from msbot_agent.cli.exit_status import MEANINGS, NO_MEANS, ExitStatus
from msbot_agent.cli.group import run
from tests.cli.test_command_tree import leaves

ROOT = Path(__file__).parents[4]
ENDS = {"exit", "Exit", "SystemExit"}
OTHERS_STATUS = {"board_commands.py", "handover.py"}
"""What passes on the status of a program that it runs: mpremote, and the demo that goes on."""


def commands() -> dict[str, click.Command]:
    context = click.Context(msbot)
    found = {}
    for name, _ in leaves(msbot, context):
        command: click.Command = msbot
        for word in name.split():
            assert isinstance(command, click.Group)
            below = command.get_command(context, word)
            assert below is not None
            command = below
        found[name] = command
    return found


def ends(file: Path) -> Iterator[ast.Call]:
    for node in ast.walk(ast.parse(file.read_text())):
        if isinstance(node, ast.Call):
            name = node.func.attr if isinstance(node.func, ast.Attribute) else getattr(node.func, "id", "")
            if name in ENDS and node.args:
                yield node


def test_no_command_ends_with_a_bare_number() -> None:
    files = [*ROOT.glob("packages/*/src/*/cli/**/*.py")]
    assert len(files) > 50
    odd = [
        f"{file.name}:{end.lineno}"
        for file in files
        for end in ends(file)
        if "ExitStatus" not in ast.unparse(end)
        and file.name not in OTHERS_STATUS
        and ast.unparse(end.args[0]) != "error.exit_code"  # click's own: 2
        and "isinstance(status, int)" not in ast.unparse(end)
    ]
    assert odd == []


def test_the_table_has_the_commands_that_may_say_no() -> None:
    modules = {}
    for name, command in commands().items():
        function = getattr(command.callback, "__wrapped__", command.callback)
        modules[name] = sys.modules[function.__module__].__file__ or ""
    says_no = {file for file in modules.values() if "ExitStatus.NO" in Path(file).read_text()}
    assert {modules[name] for name in NO_MEANS} == says_no
    assert set(MEANINGS) == set(ExitStatus)


@pytest.mark.parametrize("name", commands())
def test_a_mistake_is_status_2(name: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setattr("sys.argv", ["msbot", *name.split(), "--no-such-option"])
    with pytest.raises(SystemExit) as ended:
        run()
    told = capsys.readouterr()
    assert (ended.value.code, told.out) == (ExitStatus.MISTAKE, "")
    assert told.err.startswith("msbot: ")
    assert told.err.count("\n") == 1


@pytest.mark.parametrize("name", commands())
def test_help_is_status_0(name: str) -> None:
    done = CliRunner().invoke(msbot, [*name.split(), "--help"])
    assert done.exit_code == ExitStatus.DONE
    assert done.output.startswith("Usage: ")
