"""The unit files of systemd for a robot: its master, and a backup of its database by a timer. Pure."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

from msbot.stop.places import PREFIX as STOP_FOLDERS
from msbot_xrce.common.lazy_dataclass import dataclass

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
        # The second folder is that of STOP's socket (`msbot.stop.places`): /tmp is one of its own.
        return f"User={self.user}\n{groups}StateDirectory={self.unit}\n" \
               f"RuntimeDirectory={self.unit} {STOP_FOLDERS}{self.user}\nRuntimeDirectoryMode=0700\n" \
               f"RuntimeDirectoryPreserve=yes\nEnvironment=HOME={self.state} XDG_RUNTIME_DIR=/run/{self.unit}\n" \
               f"{paths}{CONFINED}"  # fmt: skip

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
