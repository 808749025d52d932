"""What `msbot service` asks of systemd, for a user's services or the computer's."""

from __future__ import annotations

import shutil
import subprocess
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from msbot_agent.process.user_folders import settings_folder
from msbot_xrce.errors import ConfigError

Run = Callable[[Sequence[str]], "subprocess.CompletedProcess[str]"]

PROPERTIES = ("LoadState", "ActiveState", "SubState", "Result", "NRestarts", "MainPID", "ActiveEnterTimestamp",
              "UnitFileState", "NextElapseUSecRealtime", "LastTriggerUSec")  # fmt: skip


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
            self.folder.mkdir(parents=True, exist_ok=True)
            for name, text in files.items():
                (self.folder / name).write_text(text, encoding="utf-8")
            if users:
                USERS.mkdir(parents=True, exist_ok=True)
                (USERS / f"{started[0].removesuffix('.service')}.conf").write_text(users, encoding="utf-8")
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
