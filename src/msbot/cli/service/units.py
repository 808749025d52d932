"""The unit files of systemd for a robot: its master, and a backup of its database by a timer. Pure."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

from msbot.runtime.lazy_dataclass import dataclass


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

    @property
    def unit(self) -> str:
        """The name of its units, without ending."""
        return "msbot-" + (re.sub(r"[^a-z0-9_]+", "-", self.name.casefold()).strip("-") or "robot")

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
"""

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
