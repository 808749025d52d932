"""`msbot service`: a robot's master that starts with the computer, and backups of its database."""

from __future__ import annotations

import json
import stat
import sys
from collections.abc import Mapping
from pathlib import Path

import click

from msbot.cli.robot_options import DEFAULT_BLUEPRINT, DEFAULT_LINK, database_beside
from msbot.cli.service import systemd
from msbot.cli.service.units import RobotService, shown, state_of, unit_of
from msbot_agent.cli.numbers import WholeRange
from msbot_xrce.errors import ConfigError

KEEP = 14

all_option = click.option("--system", "for_all", is_flag=True,
                          help="A service of the computer, with its own user (sudo); else one of yours.")  # fmt: skip
blueprint_argument = click.argument("blueprint", type=click.Path(path_type=Path), default=DEFAULT_BLUEPRINT)


@click.group("service")
def command() -> None:
    """Have a robot start with the computer (systemd), and its database backed up."""


@command.command("install")
@blueprint_argument
@click.option("--link", "addresses", multiple=True, default=(DEFAULT_LINK,), show_default=True,
              help="Where parts come in; may be given several times.")  # fmt: skip
@click.option("--db", metavar="FILE", help="The robot's database; robot.db beside the blueprint unless told otherwise.")
@click.option("--host", help="Where the page is served; this computer only unless told otherwise.")
@click.option("--port", type=WholeRange(1, 65535), help="Port of the page; 8080 unless told otherwise.")
@click.option(
    "--standby", is_flag=True, help="Take turns with a master on another computer; needs --db postgresql://..."
)
@click.option("--backup", "backup_at", default="daily", show_default=True, metavar="WHEN",
              help="When to back up: daily, weekly, or any OnCalendar of systemd; never.")  # fmt: skip
@click.option("--backups", type=click.Path(path_type=Path), help="Folder of the backups; `backups` beside robot.toml.")
@click.option("--keep", type=WholeRange(1, 10_000), default=KEEP, show_default=True, help="Backups that are kept.")
@all_option
@click.option("--print", "only_print", is_flag=True, help="Print the unit files and install nothing.")
def install(
    blueprint: Path, *, addresses: tuple[str, ...], db: str | None, host: str | None, port: int | None, backup_at: str,
    backups: Path | None, keep: int, for_all: bool, only_print: bool, standby: bool,
) -> None:  # fmt: skip
    """Have the master of BLUEPRINT (robot.toml) run from now on, and whenever the computer starts.

    Called again, it puts the new options in force. Where there is no systemd, the unit files are printed.
    """
    wanted = _service(
        blueprint, addresses=addresses, db=db, host=host, port=port, backup_at=backup_at, backups=backups, keep=keep,
        for_all=for_all, standby=standby,
    )  # fmt: skip
    manager = systemd.Systemd(for_all=for_all)
    if only_print or not systemd.is_there():
        if not only_print:
            click.echo("This computer is not run by systemd: nothing is installed. On one that is, these are", err=True)
            click.echo("the files; elsewhere, have your system run the command behind ExecStart=.", err=True)
        users = {str(systemd.USERS / f"{wanted.unit}.conf"): wanted.users_file()} if for_all else {}
        for line in shown({**wanted.files(), **users}, manager.folder):
            click.echo(line)
        return
    if for_all:
        for path in (wanted.blueprint, Path(wanted.python), Path(sys.prefix) / "pyvenv.cfg"):
            _check_readable(path, wanted.user)
    manager.install(wanted.files(), wanted.started(), wanted.users_file() if for_all else "")
    click.echo(f"{wanted.name} runs, and starts with the computer: {wanted.unit}.service in {manager.folder}.")
    if for_all:
        click.echo(f"It runs as the user {wanted.user}. Its database: {wanted.db}.")
    click.echo(f"Its log: {manager.logs_command(wanted.unit)}    (the page's address is in it)")
    if wanted.backup_at:
        click.echo(f"Backups: {wanted.backup_at}, the newest {keep} in {wanted.backups}.")


@command.command("remove")
@blueprint_argument
@all_option
def remove(blueprint: Path, *, for_all: bool) -> None:
    """Stop the robot of BLUEPRINT from starting; blueprint, database and backups stay as they are."""
    wanted = _service(blueprint, for_all=for_all)
    _need_systemd()
    gone = systemd.Systemd(for_all=for_all).remove(wanted.unit)
    if not gone:
        raise ConfigError(f"{wanted.name} is not installed as a service{_other_kind(wanted)}")
    click.echo(f"{wanted.name} has ended and will not start again; removed: {', '.join(gone)}.")


@command.command("status")
@blueprint_argument
@all_option
@click.option("--json", "as_json", is_flag=True, help="Print one JSON object.")
def status(blueprint: Path, *, for_all: bool, as_json: bool) -> None:
    """Say whether the robot of BLUEPRINT runs as a service, and where its log and its data are. Status 1 if not."""
    wanted = _service(blueprint, for_all=for_all)
    _need_systemd()
    manager = systemd.Systemd(for_all=for_all)
    is_installed = bool(manager.files(wanted.unit))
    master = manager.properties(f"{wanted.unit}.service") if is_installed else {}
    timer = manager.properties(f"{wanted.unit}-backup.timer") if is_installed else {}
    facts = {
        "robot": wanted.name,
        "unit": f"{wanted.unit}.service",
        "installed": is_installed,
        "running": master.get("ActiveState") == "active",
        "state": master.get("SubState", ""),
        "since": master.get("ActiveEnterTimestamp", ""),
        "restarts": int(master.get("NRestarts") or 0),
        "pid": int(master.get("MainPID") or 0),
        "next_backup": timer.get("NextElapseUSecRealtime", ""),
        "blueprint": str(wanted.blueprint),
        "database": wanted.db,
        "log": manager.logs_command(wanted.unit),
    }
    if as_json:
        click.echo(json.dumps(facts))
    else:
        for line in _words(facts):
            click.echo(line)
    if not facts["running"]:
        sys.exit(1)


def _words(facts: Mapping[str, object]) -> list[str]:
    if not facts["installed"]:
        return [f"{facts['robot']} is not installed as a service: `msbot service install` does it"]
    if facts["running"]:
        head = f"{facts['robot']} runs since {facts['since']} (process {facts['pid']}, restarts: {facts['restarts']})"
    else:
        head = f"{facts['robot']} does not run ({facts['state'] or 'unknown'}); its log says why"
    return [
        head,
        f"  unit         {facts['unit']}",
        f"  blueprint    {facts['blueprint']}",
        f"  database     {facts['database']}",
        f"  next backup  {facts['next_backup'] or 'none'}",
        f"  log          {facts['log']}",
    ]


def _service(
    blueprint: Path, *, for_all: bool, addresses: tuple[str, ...] = (), db: str | None = None, host: str | None = None,
    port: int | None = None, backup_at: str = "", backups: Path | None = None, keep: int = KEEP, standby: bool = False,
) -> RobotService:  # fmt: skip
    """The service that the user asked for, independent of the current folder.

    Raises:
        ConfigError: the blueprint has mistakes, or masters cannot take turns with that database.
    """
    from msbot.config import open_blueprint
    from msbot_agent.link import open_link

    robot, _ = open_blueprint(blueprint)
    for address in addresses:
        open_link(address, serve=True)  # report mistakes before anything is installed
    path = blueprint.absolute()
    if standby:
        from msbot.registry import check_shareable

        check_shareable(db or database_beside(path))
    chosen = [word for address in addresses for word in ("--link", address)]
    chosen += ["--host", host] if host else []
    chosen += ["--port", str(port)] if port else []
    chosen += ["--standby"] if standby else []
    beside = state_of(unit_of(robot.robot.name)) if for_all else path.parent
    return RobotService(
        name=robot.robot.name,
        python=sys.executable,
        blueprint=path,
        db=_absolute(db) if db else str(beside / "robot.db") if for_all else database_beside(path),
        options=tuple(chosen),
        for_all=for_all,
        backups=(backups or beside / "backups").absolute(),
        backup_at="" if backup_at == "never" else backup_at,
        keep=keep,
        groups=_groups_of_hardware() if for_all else (),
    )


def _groups_of_hardware() -> tuple[str, ...]:
    """The groups that may use serial lines and pins on this computer."""
    import grp

    known = {group.gr_name for group in grp.getgrall()}
    return tuple(name for name in ("dialout", "gpio", "i2c", "spi") if name in known)


def _check_readable(path: Path, user: str) -> None:
    """A user of its own reads what everybody may read.

    Raises:
        ConfigError: it may not; the text says what would be right.
    """
    for place in (path, *path.parents):
        needed = stat.S_IXOTH if place != path else stat.S_IROTH
        if place.exists() and not place.stat().st_mode & needed:
            raise ConfigError(
                f"the service runs as the user {user}, who cannot read {path}: {place} is closed to others; put the "
                f"robot and the environment of MsBOT under /srv or /opt, or leave --system out"
            )


def _absolute(db: str) -> str:
    return db if "://" in db else str(Path(db).absolute())


def _need_systemd() -> None:
    if not systemd.is_there():
        raise ConfigError("this computer is not run by systemd: `msbot service install --print` shows the unit files")


def _other_kind(wanted: RobotService) -> str:
    if systemd.Systemd(for_all=not wanted.for_all).files(wanted.unit):
        return f" of {'the computer' if wanted.for_all else 'this user'}: " + (
            "leave --system out" if wanted.for_all else "add --system"
        )
    return ""
