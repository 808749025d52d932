"""`msbot service`: a robot's master that starts with the computer, and backups of its database."""

from __future__ import annotations

import json
import os
import re
import shutil
import stat
import subprocess
import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import click

from msbot.cli.database_place import DEFAULT_BLUEPRINT, database_beside, tell_of_password
from msbot.cli.robot_options import DEFAULT_LINK
from msbot.stop.socket_folders import PREFIX as STOP_FOLDERS
from msbot_agent.cli.exit_status import ExitStatus
from msbot_agent.cli.options import WholeRange
from msbot_agent.process.user_folders import make_own_folder, settings_folder
from msbot_xrce.errors import ConfigError
from msbot_xrce.lazy import dataclass

# What `msbot service` asks of systemd, for a user's services or the computer's.


Run = Callable[[Sequence[str]], "subprocess.CompletedProcess[str]"]

PROPERTIES = (
    "LoadState",
    "ActiveState",
    "SubState",
    "Result",
    "NRestarts",
    "MainPID",
    "ActiveEnterTimestamp",
    "UnitFileState",
    "NextElapseUSecRealtime",
    "LastTriggerUSec",
)


USERS = Path("/etc/sysusers.d")
"""Where users of services are written down."""


def is_there() -> bool:
    """Whether systemd runs this computer."""
    return Path("/run/systemd/system").is_dir() and shutil.which("systemctl") is not None


def unit_folder(*, for_all: bool) -> Path:
    """Where unit files go."""
    if for_all:
        return Path("/etc/systemd/system")
    return settings_folder("systemd") / "user"


def _run(command: Sequence[str]) -> subprocess.CompletedProcess[str]:
    return subprocess.run(command, capture_output=True, text=True, check=False, timeout=60)


def _write(path: Path, text: str) -> None:
    """Write what systemd acts by: whatever the umask is, only this user may change it."""
    path.parent.mkdir(mode=0o755, exist_ok=True)
    descriptor = os.open(path, os.O_WRONLY | os.O_CREAT, 0o644)
    with os.fdopen(descriptor, "w", encoding="utf-8") as stream:
        path.chmod(0o644)  # it may be there already; before anything is in it
        stream.truncate(0)
        stream.write(text)


class Systemd:
    """Talks to systemd through its own command.

    Args:
        for_all: the computer's services, not the user's.
        run: runs a command; really runs it if absent.
    """

    def __init__(self, *, for_all: bool, run: Run = _run) -> None:
        self.folder = unit_folder(for_all=for_all)
        self._for_all = for_all
        self._run = run

    def install(self, files: Mapping[str, str], started: Sequence[str], users: str = "") -> None:
        """Write unit files, start the units, and have them start with the computer.

        Args:
            files: the unit files by name.
            started: what is started.
            users: of a service of the computer: what has its user made (sysusers.d(5)).

        Raises:
            ConfigError: a file cannot be written, or systemd refuses; the text says why.
        """
        try:
            if not self._for_all:
                make_own_folder(self.folder)
            for name, text in files.items():
                _write(self.folder / name, text)
            if users:
                _write(USERS / f"{started[0].removesuffix('.service')}.conf", users)
        except OSError as error:
            more = "; a service for the whole computer needs sudo" if self._for_all else ""
            raise ConfigError(f"cannot write {self.folder}: {error.strerror}{more}") from None
        if users:
            self._ask(["systemd-sysusers"])
        if not self._for_all:
            self._ask(["loginctl", "enable-linger"])  # so that it runs without anybody signed in
        self._systemctl("daemon-reload")
        self._systemctl("enable", *started)
        self._systemctl("restart", *started)

    def remove(self, unit: str) -> list[str]:
        """Stop the units of a robot and remove their files; returns the removed files.

        Raises:
            ConfigError: systemd refuses, or a file cannot be removed.
        """
        found = self.files(unit)
        if not found:
            return []
        runnable = [path.name for path in found if not path.name.endswith("-backup.service")]
        self._systemctl("disable", "--now", *runnable)
        try:
            for path in found:
                path.unlink()
            if self._for_all:  # the user itself stays, as the owner of the data
                (USERS / f"{unit}.conf").unlink(missing_ok=True)
        except OSError as error:
            raise ConfigError(f"cannot remove it from {self.folder}: {error.strerror}") from None
        self._systemctl("daemon-reload")
        return [path.name for path in found]

    def files(self, unit: str) -> list[Path]:
        """The unit files that exist."""
        names = (f"{unit}.service", f"{unit}-backup.timer", f"{unit}-backup.service")
        return [path for name in names if (path := self.folder / name).is_file()]

    def properties(self, unit: str) -> dict[str, str]:
        """What systemd knows about one unit.

        Raises:
            ConfigError: it cannot be asked.
        """
        answer = self._systemctl("show", unit, f"--property={','.join(PROPERTIES)}")
        return dict(line.partition("=")[::2] for line in answer.splitlines() if "=" in line)

    def logs_command(self, unit: str) -> str:
        """The command that shows the log."""
        return f"journalctl {'' if self._for_all else '--user '}-u {unit} -f"

    def _systemctl(self, *arguments: str) -> str:
        return self._ask(["systemctl", *([] if self._for_all else ["--user"]), *arguments])

    def _ask(self, command: Sequence[str]) -> str:
        try:
            done = self._run(command)
        except (OSError, subprocess.TimeoutExpired) as error:
            raise ConfigError(f"`{' '.join(command)}` does not work: {error}") from None
        if done.returncode != 0:
            words = (done.stderr or done.stdout).strip() or f"status {done.returncode}"
            raise ConfigError(f"`{' '.join(command)}` was refused: {words}")
        return done.stdout


# The unit files of systemd for a robot: its master, and a backup of its database by a timer. Pure.


LONGEST_USER = 31
"""Characters of the name of a user."""
CONFINED = """\
UMask=0077
NoNewPrivileges=yes
CapabilityBoundingSet=
ProtectSystem=strict
ProtectHome=read-only
PrivateTmp=yes
ProtectKernelTunables=yes
ProtectKernelModules=yes
ProtectKernelLogs=yes
ProtectControlGroups=yes
ProtectClock=yes
ProtectHostname=yes
RestrictNamespaces=yes
RestrictRealtime=yes
RestrictSUIDSGID=yes
RestrictAddressFamilies=AF_UNIX AF_INET AF_INET6 AF_NETLINK AF_CAN
LockPersonality=yes
RemoveIPC=yes
SystemCallArchitectures=native
SystemCallFilter=@system-service
SystemCallFilter=~@privileged
SystemCallErrorNumber=EPERM
"""
"""What no master needs is taken from it (systemd.exec(5)). Devices are left to the groups of its user: a list of them
here would not know the adapter that is plugged in next. So is memory that is written and run: ctypes needs it."""


def unit_of(name: str) -> str:
    """The name of the units of a robot, without ending."""
    return "msbot-" + (re.sub(r"[^a-z0-9_]+", "-", name.casefold()).strip("-") or "robot")


def state_of(unit: str) -> Path:
    """Where the service of the computer with that unit keeps its data."""
    return Path("/var/lib") / unit


@dataclass(frozen=True, slots=True)
class RobotService:
    """A robot that starts with the computer."""

    name: str
    """The robot's name."""
    python: str
    """The interpreter of the environment that MsBOT is in."""
    blueprint: Path
    db: str
    options: tuple[str, ...]
    """More options of `msbot master`."""
    for_all: bool
    """True: a service of the computer, which root installs; False: one of this user."""
    backups: Path
    """Folder of the backups."""
    backup_at: str
    """When to make one, in systemd's words, for example `daily`; empty: never."""
    keep: int
    """How many backups are kept."""
    groups: tuple[str, ...] = ()
    """Of a service of the computer: groups of its user besides its own, for serial lines and pins."""

    @property
    def unit(self) -> str:
        """The name of its units, without ending."""
        return unit_of(self.name)

    @property
    def user(self) -> str:
        """Whom a service of the computer runs as."""
        return self.unit[:LONGEST_USER].rstrip("-")

    @property
    def shown_db(self) -> str:
        """Its database for people, without a password."""
        from msbot.registry import without_password

        return without_password(self.db)

    @property
    def state(self) -> Path:
        """Where a service of the computer keeps its data."""
        return state_of(self.unit)

    def users_file(self) -> str:
        """What has the system make that user (sysusers.d(5))."""
        about = escaped(self.name).replace("\\", "").replace('"', "").replace(":", " ")
        return f'u {self.user} - "MsBOT robot {about}" {self.state}\n'

    def files(self) -> dict[str, str]:
        """The unit files by name."""
        made = {f"{self.unit}.service": self._master()}
        if self.backup_at:
            made[f"{self.unit}-backup.service"] = self._backup()
            made[f"{self.unit}-backup.timer"] = self._timer()
        return made

    def started(self) -> list[str]:
        """The units to start now, and whenever the computer starts."""
        return [f"{self.unit}.service", *([f"{self.unit}-backup.timer"] if self.backup_at else [])]

    def _master(self) -> str:
        command = self._msbot("master", str(self.blueprint), "--db", self.db, *self.options)
        return f"""\
[Unit]
Description=MsBOT robot {escaped(self.name)}
Wants=network-online.target
After=network-online.target

[Service]
Type=exec
WorkingDirectory={escaped(str(self.blueprint.parent))}
Environment=PYTHONUNBUFFERED=1
ExecStart={command}
Restart=always
RestartSec=2
{self._confinement()}
[Install]
WantedBy={"multi-user.target" if self.for_all else "default.target"}
"""

    def _backup(self) -> str:
        command = self._msbot("db", "backup", str(self.backups), "--keep", str(self.keep), "--db", self.db)
        return f"""\
[Unit]
Description=Backup of the MsBOT robot {escaped(self.name)}

[Service]
Type=oneshot
WorkingDirectory={escaped(str(self.blueprint.parent))}
ExecStart={command}
{self._confinement()}"""

    def _timer(self) -> str:
        return f"""\
[Unit]
Description=Backups of the MsBOT robot {escaped(self.name)}

[Timer]
OnCalendar={self.backup_at}
Persistent=true

[Install]
WantedBy=timers.target
"""

    def _confinement(self) -> str:
        """What a service of the computer may do: as its own user, and no more than a master needs."""
        if not self.for_all:
            return ""
        written = [] if "://" in self.db else [Path(self.db).parent]
        places = sorted({str(place) for place in (*written, self.backups) if not place.is_relative_to(self.state)})
        paths = "".join(f"ReadWritePaths={quoted(place)}\n" for place in places)
        groups = f"SupplementaryGroups={' '.join(self.groups)}\n" if self.groups else ""
        # The second folder is that of STOP's socket (`msbot.stop.socket_folders`): /tmp is one of its own.
        return (
            f"User={self.user}\n{groups}StateDirectory={self.unit}\nStateDirectoryMode=0700\n"
            f"RuntimeDirectory={self.unit} {STOP_FOLDERS}{self.user}\nRuntimeDirectoryMode=0700\n"
            f"RuntimeDirectoryPreserve=yes\nEnvironment=HOME={self.state} XDG_RUNTIME_DIR=/run/{self.unit}\n"
            f"{paths}{CONFINED}"
        )

    def _msbot(self, *arguments: str) -> str:
        return " ".join([quoted(self.python), "-P", "-m", "msbot", *map(quoted, arguments)])


def quoted(word: str) -> str:
    """One word of a command line as systemd reads it (systemd.service(5), "Command lines")."""
    plain = escaped(word).replace("$", "$$")
    if re.fullmatch(r"[A-Za-z0-9_@%+=:,./$-]+", plain):
        return plain
    return '"' + plain.replace("\\", "\\\\").replace('"', '\\"') + '"'


def escaped(text: str) -> str:
    """A text on one line, escaped so that systemd substitutes nothing in it."""
    return " ".join(text.split("\n")).replace("%", "%%")


def shown(files: dict[str, str], folder: Path) -> Sequence[str]:
    """The files for a person who puts them in place by hand."""
    return [line for name, text in files.items() for line in (f"# {folder / name}", text)]


KEEP = 14

all_option = click.option(
    "--system",
    "for_all",
    is_flag=True,
    help="A system service with a user of its own (needs sudo), instead of one of yours.",
)
blueprint_argument = click.argument("blueprint", type=click.Path(path_type=Path), default=DEFAULT_BLUEPRINT)


@click.group("service")
def command() -> None:
    """Start a robot with the computer (systemd), and back up its database."""


@command.command("call", hidden=True, context_settings={"ignore_unknown_options": True, "allow_extra_args": True})
def call() -> None:
    """What `ros2 service call` makes people type."""
    raise click.UsageError("a service of a part is called by `msbot call SLOT.PORT VALUE...`; this starts robots")


@command.command("list", hidden=True, context_settings={"ignore_unknown_options": True, "allow_extra_args": True})
def list_services() -> None:
    """What `ros2 service list` makes people type."""
    raise click.UsageError("`msbot topic list -t` lists the services of parts, too; this starts robots")


@command.command("install")
@blueprint_argument
@click.option(
    "--link",
    "addresses",
    multiple=True,
    default=(DEFAULT_LINK,),
    show_default=True,
    help="Where parts connect; repeatable.",
)
@click.option("--db", metavar="FILE", help="The robot's database; default: beside the blueprint, ending .db.")
@click.option("--host", help="Where the page is served; default: this computer only.")
@click.option("--port", type=WholeRange(1, 65535), help="Port of the page; default 8080.")
@click.option(
    "--standby", is_flag=True, help="Share the robot with a master on another computer; needs --db postgresql://..."
)
@click.option(
    "--backup",
    "backup_at",
    default="daily",
    show_default=True,
    metavar="WHEN",
    help="When to back up: daily, weekly, never, or an OnCalendar expression of systemd.",
)
@click.option(
    "--backups", type=click.Path(path_type=Path), help="Folder for the backups; default: `backups` beside robot.toml."
)
@click.option("--keep", type=WholeRange(1, 10_000), default=KEEP, show_default=True, help="How many backups to keep.")
@all_option
@click.option("--print", "only_print", is_flag=True, help="Print the unit files and install nothing.")
def install(
    blueprint: Path,
    *,
    addresses: tuple[str, ...],
    db: str | None,
    host: str | None,
    port: int | None,
    backup_at: str,
    backups: Path | None,
    keep: int,
    for_all: bool,
    only_print: bool,
    standby: bool,
) -> None:
    """Run the master of BLUEPRINT (robot.toml) as a service, now and whenever the computer starts.

    Run it again to change options. Without systemd, it prints the unit files.
    """
    wanted = _service(
        blueprint,
        addresses=addresses,
        db=db,
        host=host,
        port=port,
        backup_at=backup_at,
        backups=backups,
        keep=keep,
        for_all=for_all,
        standby=standby,
    )
    tell_of_password(wanted.db)
    manager = Systemd(for_all=for_all)
    if only_print or not is_there():
        if not only_print:
            click.echo("This computer is not run by systemd: nothing is installed. On one that is, these are", err=True)
            click.echo("the files; elsewhere, have your system run the command behind ExecStart=.", err=True)
        users = {str(USERS / f"{wanted.unit}.conf"): wanted.users_file()} if for_all else {}
        for line in shown({**wanted.files(), **users}, manager.folder):
            click.echo(line)
        return
    if for_all:
        for path in (wanted.blueprint, Path(wanted.python), Path(sys.prefix) / "pyvenv.cfg"):
            _check_readable(path, wanted.user)
    manager.install(wanted.files(), wanted.started(), wanted.users_file() if for_all else "")
    click.echo(f"{wanted.name} runs, and starts with the computer: {wanted.unit}.service in {manager.folder}.")
    if for_all:
        click.echo(f"It runs as the user {wanted.user}. Its database: {wanted.shown_db}.")
    click.echo(f"Its log: {manager.logs_command(wanted.unit)}    (the page's address is in it)")
    if wanted.backup_at:
        click.echo(f"Backups: {wanted.backup_at}, the newest {keep} in {wanted.backups}.")


@command.command("remove")
@blueprint_argument
@all_option
def remove(blueprint: Path, *, for_all: bool) -> None:
    """End and remove the service; blueprint, database and backups stay."""
    wanted = _service(blueprint, for_all=for_all)
    _need_systemd()
    gone = Systemd(for_all=for_all).remove(wanted.unit)
    if not gone:
        raise ConfigError(f"{wanted.name} is not installed as a service{_other_kind(wanted)}")
    click.echo(f"{wanted.name} has ended and will not start again; removed: {', '.join(gone)}.")


@command.command("status")
@blueprint_argument
@all_option
@click.option("--json", "as_json", is_flag=True, help="Print one JSON object.")
def status(blueprint: Path, *, for_all: bool, as_json: bool) -> None:
    """Show whether the service runs (else status 1), since when, and where its log and data are."""
    wanted = _service(blueprint, for_all=for_all)
    _need_systemd()
    manager = Systemd(for_all=for_all)
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
        "database": wanted.shown_db,
        "log": manager.logs_command(wanted.unit),
    }
    if as_json:
        click.echo(json.dumps(facts))
    else:
        for line in _words(facts):
            click.echo(line)
    if not facts["running"]:
        sys.exit(ExitStatus.NO)


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
    blueprint: Path,
    *,
    for_all: bool,
    addresses: tuple[str, ...] = (),
    db: str | None = None,
    host: str | None = None,
    port: int | None = None,
    backup_at: str = "",
    backups: Path | None = None,
    keep: int = KEEP,
    standby: bool = False,
) -> RobotService:
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
    if not is_there():
        raise ConfigError("this computer is not run by systemd: `msbot service install --print` shows the unit files")


def _other_kind(wanted: RobotService) -> str:
    if Systemd(for_all=not wanted.for_all).files(wanted.unit):
        return f" of {'the computer' if wanted.for_all else 'this user'}: " + (
            "leave --system out" if wanted.for_all else "add --system"
        )
    return ""
