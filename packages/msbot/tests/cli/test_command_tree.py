"""Every command that tells facts tells them as JSON, and every one that opens a database says which robot is meant."""

from __future__ import annotations

from collections.abc import Iterator

import click
import pytest

from msbot_agent.cli import msbot
from msbot_agent.cli.options import FiniteRange, WholeRange

RUNS = "runs until it is ended; `clients`, `parts` and `why` tell how it is"
SECRET = "shows a secret this once, to be written down"
WRITES = "writes a file, or text of a format of its own, for programs already"
DOES = "does one thing, and says that it is done"

NO_FACTS = {
    **dict.fromkeys(("master", "part", "bus serve", *(f"agent {transport}" for transport in (
        "udp4", "udp6", "tcp4", "tcp6", "serial", "multiserial", "pseudoterminal", "can", "canfd", "can-legacy",
    ))), RUNS),
    **dict.fromkeys(("board run", "board shell", "play", "relay", "gateway", "router"), RUNS),
    **dict.fromkeys(("init", "export", "completion", "idl to-python", "idl to-idl", "idl to-c"), WRITES),
    **dict.fromkeys(("rec save", "log filter", "log export", "library ros-package"), WRITES),
    **dict.fromkeys((
        "library add", "db migrate", "db backup", "db restore", "service install", "service remove", "user role",
        "user remove", "key board", "key remove", "bus send", "board reset", "rec start", "rec stop",
        "class apply", "class undo", "pupils robot", "class join", "class leave", "user revoke",
    ), DOES),
    **dict.fromkeys(("user add", "user passwd", "user ticket", "user token", "key new"), SECRET),
    "help": "shows a page of the handbook, which is a text",
    **dict.fromkeys(("service call", "service list"), "says which command it is here"),
    "plot": "draws; `--out FILE.csv` has the numbers",
    "log diff": "writes lines as `diff` does, and its exit status says whether there are any",
}  # fmt: skip
"""Commands without `--json`, and why."""

BLUEPRINT = "its blueprint says which robot"
WHOLE = "is about the whole database"

NOT_ONE_ROBOT = {
    **dict.fromkeys(("master", "diff", "apply", "slot add", "service install"), BLUEPRINT),
    **dict.fromkeys(("robots", "db backup", "db check", "db migrate", "db restore"), WHOLE),
    **dict.fromkeys(("class list", "class stop", "class apply", "class undo"), "is about all robots of the class"),
    **dict.fromkeys(
        (
            "user add",
            "user list",
            "user passwd",
            "user remove",
            "user revoke",
            "user role",
            "user ticket",
            "user token",
        ),
        "people may sign in at every robot of the database",
    ),
    **dict.fromkeys(
        ("key board", "key new", "key list", "key remove"), "a key is its part's, whichever robot that joins"
    ),
}
"""Commands with `--db` and without `--robot`, and why."""


def leaves(command: click.Command, context: click.Context, name: str = "") -> Iterator[tuple[str, frozenset[str]]]:
    """Every command that does something, with all its options."""
    if isinstance(command, click.Group):
        for sub in command.list_commands(context):
            below = command.get_command(context, sub)
            assert below is not None
            yield from leaves(below, click.Context(below, context, sub), f"{name} {sub}".strip())
        if not command.invoke_without_command:
            return
    yield name, frozenset(option for one in command.params for option in one.opts)


@pytest.fixture(scope="module")
def tree() -> dict[str, frozenset[str]]:
    return dict(leaves(msbot, click.Context(msbot)))


def test_every_command_that_tells_facts_tells_them_as_json(tree: dict[str, frozenset[str]]) -> None:
    assert {name for name, options in tree.items() if "--json" not in options} == set(NO_FACTS)


def test_every_command_with_a_database_says_which_robot(tree: dict[str, frozenset[str]]) -> None:
    assert {name for name, has in tree.items() if "--db" in has and "--robot" not in has} == set(NOT_ONE_ROBOT)


def test_a_command_that_says_which_robot_says_which_database(tree: dict[str, frozenset[str]]) -> None:
    assert [name for name, options in tree.items() if "--robot" in options and "--db" not in options] == []


def number_types(command: click.Command, context: click.Context) -> Iterator[tuple[str, click.ParamType[object]]]:
    """Every option and argument that takes a number, of a command and those below it."""
    for one in command.params:
        if isinstance(one.type, type(click.INT) | type(click.FLOAT)):
            yield f"{context.command_path} {one.name}", one.type
    if isinstance(command, click.Group):
        for sub in command.list_commands(context):
            below = command.get_command(context, sub)
            assert below is not None
            yield from number_types(below, click.Context(below, context, sub))


def test_every_number_says_what_would_be_right() -> None:
    """click's own say "not a valid integer range", and take `1_0` and `nan`."""
    numbers = dict(number_types(msbot, click.Context(msbot)))
    assert len(numbers) > 40
    assert [name for name, kind in numbers.items() if not isinstance(kind, WholeRange | FiniteRange)] == []
