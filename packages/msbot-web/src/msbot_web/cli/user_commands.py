"""`msbot user`: who may sign in on the page; the same as its Admin page, for the terminal and for a whole class."""

from __future__ import annotations

import csv
import json
import os
import sys
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, TextIO

import click

from msbot.cli.change.robot_access import perform, say
from msbot.cli.database_place import existing_database
from msbot.cli.robot_options import db_option, library_option, robot_and_json_options, robot_options, user_name
from msbot.operations.rights import Role, role_named
from msbot_agent.cli.options import json_option
from msbot_agent.cli.table import for_terminal, print_table
from msbot_agent.process.end_signals import run_to_end
from msbot_agent.text.untrusted_input import open_input_file
from msbot_xrce.counting import amount
from msbot_xrce.errors import ConfigError

if TYPE_CHECKING:
    from msbot_web.access.accounts import Accounts


LONGEST_READ = 10_000
"""Characters of a password that are read from standard input, which may have no end; fewer are too many already."""
ROLES = tuple(role.word for role in Role)

role_option = click.option(
    "--role", type=click.Choice(ROLES), default="student", show_default=True, help="What they may do."
)
stdin_option = click.option(
    "--password-stdin", "from_stdin", is_flag=True, help="Take the password from standard input instead of asking."
)
generate_option = click.option("--generate", is_flag=True, help="Generate a password and print it.")


@click.group("user")
def user_command() -> None:
    """The people who may sign in on the page. A running master applies changes within seconds."""


@user_command.command("list")
@db_option
@json_option
def list_users(db: str | None, *, as_json: bool) -> None:
    """List everybody who may sign in, with roles, API tokens and relays."""
    with _accounts(db) as accounts:
        people = accounts.users()
    if as_json:
        told = [
            {"name": one.name, "role": one.role.word, "tokens": one.api_tokens, "tickets": one.tickets}
            for one in people
        ]
        click.echo(json.dumps(told))
        return
    if not people:
        click.echo("Nobody may sign in yet: `msbot master` prints a link for the first administrator.")
        return
    print_table(
        ("name", "role", "API tokens", "relays and agents"),
        [(one.name, one.role.word, ", ".join(one.api_tokens), ", ".join(one.tickets)) for one in people],
    )


@user_command.command("add")
@click.argument("name", required=False)
@click.option(
    "--list",
    "path",
    metavar="FILE",
    type=click.Path(path_type=Path),
    help="A class list (CSV): everybody in it is added; missing passwords are generated.",
)
@click.option(
    "--tickets",
    metavar="FILE",
    type=click.Path(path_type=Path),
    help="With --list: write names and passwords to this CSV file instead of the terminal.",
)
@role_option
@stdin_option
@generate_option
@db_option
def add(
    name: str | None,
    *,
    path: Path | None,
    tickets: Path | None,
    role: str,
    from_stdin: bool,
    generate: bool,
    db: str | None,
) -> None:
    """Let NAME sign in, or everybody of a class list."""
    if (name is None) == (path is None):
        raise click.UsageError("say who: NAME, or --list FILE")
    if path is not None:
        _add_class(path, tickets, role, db)
        return
    assert name is not None
    with _accounts(db) as accounts:
        password = _password(from_stdin=from_stdin, generate=generate)
        run_to_end(accounts.add_user(name, role_named(role), password, who=user_name()))
    click.echo(
        f"{name} may sign in as {role_named(role).with_article}" + (f"; the password is {password}" if generate else "")
    )


@user_command.command("passwd")
@click.argument("name")
@stdin_option
@generate_option
@db_option
def passwd(name: str, *, from_stdin: bool, generate: bool, db: str | None) -> None:
    """Set a new password; NAME's sessions and API tokens end."""
    with _accounts(db) as accounts:
        password = _password(from_stdin=from_stdin, generate=generate)
        run_to_end(accounts.change_password(name, password, who=user_name()))
    click.echo(f"{name} has another password" + (f": {password}" if generate else ""))


@user_command.command("role")
@click.argument("name")
@click.argument("role", type=click.Choice(ROLES))
@db_option
def change_role(name: str, role: str, db: str | None) -> None:
    """Give NAME another ROLE."""
    with _accounts(db) as accounts:
        run_to_end(accounts.change_role(name, role, who=user_name()))
    click.echo(f"{name} is {role_named(role).with_article} now")


@user_command.command("remove")
@click.argument("names", metavar="NAME...", nargs=-1, required=True)
@db_option
def remove(names: tuple[str, ...], db: str | None) -> None:
    """Remove people."""
    with _accounts(db) as accounts:
        for name in names:
            run_to_end(accounts.remove_user(name, who=user_name()))
            click.echo(f"{name} can no longer sign in")


@user_command.command("token")
@click.argument("name")
@click.argument("purpose")
@db_option
def new_token(name: str, purpose: str, db: str | None) -> None:
    """Print an API token that gives programs NAME's rights; PURPOSE names it."""
    with _accounts(db) as accounts:
        click.echo(run_to_end(accounts.new_token(name, purpose, who=user_name())))


@user_command.command("ticket")
@click.argument("name")
@click.argument("relay")
@db_option
def new_ticket(name: str, relay: str, db: str | None) -> None:
    """Print a token with which the parts of RELAY, a relay or an agent, join as those of the teacher NAME.

    It gives no other access. `msbot user revoke NAME RELAY` revokes it.
    """
    with _accounts(db) as accounts:
        click.echo(run_to_end(accounts.new_ticket(name, relay, who=user_name())))


@user_command.command("revoke")
@click.argument("name")
@click.argument("purpose")
@db_option
def revoke(name: str, purpose: str, db: str | None) -> None:
    """Revoke an API token, or the token of a relay."""
    with _accounts(db) as accounts:
        run_to_end(accounts.remove_token(name, purpose, who=user_name()))
    click.echo(f"the token of {name} for {purpose} is worthless now")


def _add_class(path: Path, tickets: Path | None, role: str, db: str | None) -> None:
    from msbot_web.access.class_list import new_accounts

    people = new_accounts(_octets(path), str(path), role_named(role))
    with _accounts(db) as accounts:
        there = {user.name for user in accounts.users()}
        for one in people:  # all of them, before anybody is added
            if one.name in there:
                raise ConfigError(f"{path}, line {one.line}: {one.name!r} may sign in already; nobody was added")
        rows = [(one.name, one.role.word, one.password) for one in people]
        if tickets is not None:
            _write_tickets(tickets, rows)
        run_to_end(accounts.add_people(people, who=user_name()))
    if tickets is None:
        _write_rows(sys.stdout, rows)
    click.echo(
        f"{amount(len(rows), 'person', 'people')} may sign in"
        + (f"; their passwords are in {tickets}" if tickets else ""),
        err=True,
    )


def _octets(path: Path) -> bytes:
    from msbot_web.access.class_list import MOST_BYTES

    try:
        with open_input_file(path) as stream:
            return stream.read(MOST_BYTES + 1) or b""
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read ({error.strerror}); name another file") from None


def _write_tickets(path: Path, rows: list[tuple[str, str, str]]) -> None:
    try:
        with open(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "w", encoding="utf-8") as stream:
            _write_rows(stream, rows)
    except FileExistsError:
        raise ConfigError(f"{path} exists already and is not overwritten: name another file") from None
    except OSError as error:
        raise ConfigError(f"{path} cannot be written ({error.strerror}); name another file") from None


def _write_rows(stream: TextIO, rows: list[tuple[str, str, str]]) -> None:
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(("name", "role", "password"))
    writer.writerows(rows)


def _password(*, from_stdin: bool, generate: bool) -> str:
    """The new password, typed, read or generated.

    Raises:
        ConfigError: there is nobody to ask.
    """
    if from_stdin and generate:
        raise click.UsageError("--password-stdin or --generate, not both")
    if generate:
        from msbot_web.access.class_list import new_password

        return new_password()
    if from_stdin:
        return sys.stdin.readline(LONGEST_READ).rstrip("\r\n")
    if not sys.stdin.isatty():
        raise ConfigError("nobody is there to type a password: add --password-stdin or --generate")
    return str(click.prompt("Password", hide_input=True, confirmation_prompt=True))


@contextmanager
def _accounts(db: str | None) -> Iterator[Accounts]:
    """The people of a database.

    Raises:
        ConfigError: there is no database, or what was asked for makes no sense.
        RegistryError: the database cannot be used.
    """
    from msbot.registry import open_registry
    from msbot_web.access.accounts import Accounts
    from msbot_web.stored_data import RegistryUsers

    with open_registry(existing_database(db)) as registry:
        yield Accounts(RegistryUsers(registry), clock=time.monotonic)


# `msbot pupils`: a class at one robot: its groups, freeze all, take over, hand back; and a robot for a class.


@click.group("pupils")
def pupils_command() -> None:
    """A class at one robot: groups with slots of their own, freeze all, take over, hand back, raised hands.

    The page Pupils has the same, and makes the pupils' accounts and tickets.
    """


@pupils_command.command("robot")
@click.argument("path", type=click.Path(path_type=Path))
@click.option("--groups", required=True, metavar="NAME,NAME", help="The groups: letters and digits.")
@click.option(
    "--from",
    "source",
    type=click.Path(path_type=Path),
    help="The robot of one group; default: a sample with a program, a distance sensor, a bumper, two motors, a lamp.",
)
@library_option
def robot(path: Path, groups: str, source: Path | None, folders: tuple[Path, ...]) -> None:
    """Write a blueprint in which every group has the same slots and wires to the new file PATH.

    A slot `fan` becomes `fan_Red`, `fan_Blue`; the page Pupils makes the groups by these names.
    """
    from msbot.config import (
        GROUP_ROBOT_TOML,
        blueprint_toml,
        for_groups,
        load_library,
        open_blueprint,
        parse_blueprint,
        write_new,
    )

    if source is None:
        one = parse_blueprint(GROUP_ROBOT_TOML, load_library(*folders))
    else:
        one, _ = open_blueprint(source, *folders)
    names = [name.strip() for name in groups.split(",") if name.strip()]
    made = for_groups(one, names)
    groups_made = amount(len(names), "group")
    write_new(path, f"# A robot for {groups_made}, written by `msbot pupils robot`.\n\n{blueprint_toml(made)}")
    click.echo(
        f"{path}: {amount(len(made.slots), 'slot')} for {groups_made}; `msbot master {path} --host 0.0.0.0` runs it"
    )


@pupils_command.command("list")
@json_option
@robot_options
def list_pupils(db: str | None, robot: str | None, *, as_json: bool) -> None:
    """Show groups, running and held programs, and raised hands."""
    found = perform(db, robot, "classroom", {})
    if as_json:
        click.echo(json.dumps(found))
        return
    _show_pupils(found)


@pupils_command.command("freeze")
@click.argument("reason", default="")
@robot_and_json_options
def freeze(reason: str, db: str | None, robot: str | None) -> None:
    """Hold all pupils' programs; what they drive goes to its safe value."""
    say(db, robot, "freeze", {"reason": reason})


@pupils_command.command("go")
@robot_and_json_options
def go(db: str | None, robot: str | None) -> None:
    """Let the pupils' programs continue; STOP needs `msbot go`."""
    say(db, robot, "thaw", {})


@pupils_command.command("take-over")
@click.argument("pupil")
@click.option("--run", is_flag=True, help="Run it for the teacher instead of holding it.")
@robot_and_json_options
def take_over(pupil: str, db: str | None, robot: str | None, *, run: bool) -> None:
    """Take over the program of PUPIL and hold it until `hand-back`; --run runs it for the teacher."""
    say(db, robot, "take_over", {"pupil": pupil, "run": run})


@pupils_command.command("hand-back")
@click.argument("pupil")
@robot_and_json_options
def hand_back(pupil: str, db: str | None, robot: str | None) -> None:
    """Give PUPIL the program back."""
    say(db, robot, "hand_back", {"pupil": pupil})


@pupils_command.command("group")
@click.argument("group")
@click.option("--pupil", "pupils", multiple=True, metavar="NAME", help="A pupil of it; repeatable.")
@click.option("--slot", "slots", multiple=True, metavar="SLOT", help="A slot of its own; repeatable.")
@robot_and_json_options
def group(group: str, pupils: tuple[str, ...], slots: tuple[str, ...], db: str | None, robot: str | None) -> None:
    """Make or change a group of pupils with slots of its own; they leave their former groups."""
    say(db, robot, "group", {"group": group, "pupils": list(pupils), "slots": list(slots)})


@pupils_command.command("ungroup")
@click.argument("group")
@robot_and_json_options
def ungroup(group: str, db: str | None, robot: str | None) -> None:
    """Remove a group; its slots are free for everybody."""
    say(db, robot, "remove_group", {"group": group})


def _show_pupils(found: Mapping[str, Any]) -> None:
    frozen = found["frozen"]
    if frozen is not None:
        click.echo(for_terminal(f"FROZEN by {frozen['by']}{': ' if frozen['reason'] else ''}{frozen['reason']}"))
    if found["groups"]:
        rows = [(one["group"], ", ".join(one["slots"]) or "-", ", ".join(one["pupils"])) for one in found["groups"]]
        print_table(("group", "slots", "pupils"), rows)
        click.echo()
    if found["pupils"]:
        print_table(("pupil", "program", "hand up", "held"), [_pupil(one) for one in found["pupils"]])
    else:
        words = (
            "No pupil is here, and no group has any: `msbot pupils group` makes one, the page Pupils makes accounts."
        )
        click.echo(for_terminal(words))


def _pupil(one: Mapping[str, Any]) -> tuple[str, ...]:
    where = ", ".join(one["slots"]) or ("without a slot" if one["runs"] else "-")
    return one["pupil"], where, "-" if one["hand_s"] is None else f"{one['hand_s']:.0f} s", one["held"] or "-"
