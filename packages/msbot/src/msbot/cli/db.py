"""`msbot db`: take care of a robot's database."""

from __future__ import annotations

import json
import re
import shlex
import sys
from datetime import datetime
from pathlib import Path

import click

from msbot.cli.database_place import existing_database
from msbot.cli.robot_options import db_option
from msbot_agent.cli.exit_status import ExitStatus
from msbot_agent.cli.options import WholeRange
from msbot_agent.process.user_folders import make_own_folder
from msbot_xrce.counting import amount
from msbot_xrce.errors import ConfigError


@click.group("db")
def command() -> None:
    """Migrate, back up, restore and check a robot's database."""


@command.command("migrate")
@db_option
def migrate(db: str | None) -> None:
    """Update the database of an older MsBOT and keep a copy, as `msbot master` does at its start."""
    from msbot.registry import without_password
    from msbot.registry.maintenance import database_maintenance

    address = existing_database(db)
    words = without_password(address)
    done = database_maintenance.migrate(address)
    if done.before == done.after:
        click.echo(f"{words} is up to date: schema {done.after}.")
    else:
        click.echo(f"{words} is brought from schema {done.before} to {done.after}.")


@command.command("backup")
@click.argument("target", metavar="FILE|FOLDER", type=click.Path(path_type=Path))
@click.option(
    "--keep",
    type=WholeRange(1, 10_000),
    metavar="N",
    help="The target is a folder: name the file by date and time, and keep the newest N.",
)
@db_option
def backup(target: Path, db: str | None, *, keep: int | None) -> None:
    """Copy the database to a new SQLite FILE, even while a master uses it."""
    from msbot.registry import without_password
    from msbot.registry.maintenance import database_maintenance

    address = existing_database(db)
    words = without_password(address)
    file = target
    if keep is not None:
        _make_folder(target)
        stem = "robot" if "://" in address else Path(address).stem
        file = target / f"{stem}-{datetime.now():%Y%m%d-%H%M%S}.db"
    elif not target.parent.is_dir():
        raise ConfigError(
            f"{target}: there is no folder {target.parent}; create it with `mkdir -p {shlex.quote(str(target.parent))}`"
        )
    rows = database_maintenance.back_up(address, file)
    click.echo(f"{file} is written: {amount(rows, 'row')} of {words}.")
    if words := database_maintenance.too_large_for_page(file.stat().st_size):
        click.echo(words, err=True)
    if keep is not None:
        for old in _older(target, stem, keep):
            old.unlink()
            click.echo(f"{old} is removed: the newest {keep} are kept.")


def _make_folder(folder: Path) -> None:
    try:
        make_own_folder(folder)  # a backup contains the keys of parts
    except OSError as error:
        raise ConfigError(f"{folder} cannot be used for backups: {error.strerror}; name another folder") from None


def _older(folder: Path, stem: str, keep: int) -> list[Path]:
    """All backups of a database but the newest; files with other names are left alone."""
    named = re.compile(re.escape(stem) + r"-\d{8}-\d{6}\.db")
    found = sorted((path for path in folder.iterdir() if named.fullmatch(path.name)), key=lambda path: path.name)
    return found[:-keep]


@command.command("restore")
@click.argument("file", type=click.Path(path_type=Path))
@click.option("--yes", is_flag=True, help="Do not ask.")
@db_option
def restore(file: Path, db: str | None, *, yes: bool) -> None:
    """Replace the content of the database by a backup.

    The former content is kept in a copy. Stop the masters of its robots first.
    """
    from msbot.cli.database_place import DEFAULT_BLUEPRINT, database_beside
    from msbot.registry import without_password
    from msbot.registry.maintenance import database_maintenance

    address = db or database_beside(DEFAULT_BLUEPRINT)
    words = without_password(address)
    database_maintenance.find_backup(file)  # before anybody is asked
    if not yes:
        click.confirm(f"Put the content of {file} in place of all that {words} has?", abort=True)
    kept = database_maintenance.restore(file, address)
    click.echo(f"{words} has the content of {file}.")
    if kept is not None:
        click.echo(f"What it had before is in {kept}.")


@command.command("check")
@click.option("--json", "as_json", is_flag=True, help="Print a JSON list of sentences.")
@db_option
def check(db: str | None, *, as_json: bool) -> None:
    """Find damage and contradictions (status 1)."""
    from msbot.registry import without_password
    from msbot.registry.maintenance import database_maintenance

    address = existing_database(db)
    words = without_password(address)
    findings = database_maintenance.check(address)
    if as_json:
        click.echo(json.dumps(findings))
    else:
        for sentence in findings:
            click.echo(sentence)
        click.echo(f"{words}: {amount(len(findings), 'problem')}." if findings else f"{words} is in order.")
    if findings:
        sys.exit(ExitStatus.NO)
