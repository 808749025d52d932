"""Applies the card's settings to this Linux, and what the page asks for. Only here are files of the system written and
programs started, each with a list of words."""

from __future__ import annotations

import json
import os
import shutil
import stat
import subprocess
import sys
from dataclasses import asdict
from pathlib import Path

from msbot_card import config_txt, growth, system_files
from msbot_card.files import keep, read, remove, wipe
from msbot_card.settings import LARGEST, Administrator, Settings, SettingsError, changed, dump, load, parse
from msbot_card.updates import LARGEST as LARGEST_PACKAGE
from msbot_card.updates import PACKAGE, Store, UpdateError

SETUP, TROUBLE = "msbot-setup.toml", "msbot-setup-mistakes.txt"
CLOSED = "Until it is corrected or removed, no visitor of the page can become the administrator."
LARGEST_CONFIG = 100_000
_IFF_UP = 1
PROGRAM_S = 240.0
"""How long a program of the system may take."""


class System:
    """This computer.

    Args:
        root: where its files are; another folder in tests.
    """

    def __init__(self, root: Path = Path("/")) -> None:
        self._root = root
        self._boot = root / "boot/firmware"
        self._kept = root / "data/card/settings.json"
        self.package = root / "var/lib/msbot/update.deb"
        """Where the page puts an update."""
        python = f"python{sys.version_info.major}.{sys.version_info.minor}"
        self._refused = ""
        self.store = Store(root / "data/card", root / "data/msbot/robot.db", python)

    # What is set

    def settings(self) -> Settings:
        """What is set; what was never set is as the card was flashed."""
        text = read(self._kept, LARGEST)
        if text is None:
            return Settings()
        try:
            return load(text)
        except SettingsError as error:
            say(str(error))
            return Settings()

    def change(self, table: object) -> Settings:
        """Set what a table names, keep it, and apply what works without a restart.

        Raises:
            SettingsError: something in it makes no sense.
        """
        before = self.settings()
        after, administrator = changed(table, before)
        if administrator is not None:
            raise SettingsError("people are set on the page itself")
        keep(self._kept, dump(after))
        self._write(after)
        self._edit_config(after)
        if after.name != before.name:
            self._name(after.name)
            self._run("systemctl", "try-restart", "avahi-daemon.service")
        if (after.country, after.network, after.key) != (before.country, before.network, before.key):
            self._wifi(after)
        return after

    # At the start

    def start(self) -> None:
        """Before network and master: take a set-up file in, apply what is set, put the version in force."""
        settings, taken = self.settings(), None
        if (self._root / "data/card").is_mount() or (self._root / "data").is_mount():
            taken = self._take_setup(settings)
            self._version()
        settings, administrator = taken or (settings, None)
        self._write(settings)
        self._name(settings.name)
        self._edit_config(settings)
        if administrator is not None and (refused := self._add(administrator)):
            self._explain("has set everything but the administrator", refused)
        elif taken is not None:  # only now: when the power goes before, the next start does all this
            with Writable(self):
                remove(self._boot / TROUBLE)
                wipe(self._boot / SETUP)

    def _take_setup(self, before: Settings) -> tuple[Settings, Administrator | None] | None:
        """Keep what the file on the boot partition says; None: there is none, or it makes no sense."""
        try:
            text = read(self._boot / SETUP, LARGEST)
        except OSError as error:
            self._explain("cannot be read", error.strerror or str(error))
            return None
        if text is None:
            if (self._boot / TROUBLE).exists():  # the file was removed, and not corrected
                with Writable(self):
                    remove(self._boot / TROUBLE)
            return None
        try:
            after, administrator = parse(text, before)
        except SettingsError as error:
            self._explain("was not used", str(error))
            return None
        keep(self._kept, dump(after))
        return after, administrator

    def _explain(self, head: str, mistake: str) -> None:
        """Write down what is wrong with the set-up file, which stays, beside it."""
        say(f"{SETUP} {head}: {mistake}")
        with Writable(self):
            keep(self._boot / TROUBLE, f"{SETUP} {head}:\r\n{mistake}\r\n{CLOSED}\r\n".encode())

    def _add(self, administrator: Administrator) -> str:
        """Let the administrator sign in; the password goes to the robot's own program, which keeps a hash of it.

        Returns:
            why not; empty: it is done.
        """
        user, told = ["/usr/lib/msbot/bin/msbot", "user"], f"{administrator.password}\n"
        of_all = ["--password-stdin", "--db", "/var/lib/msbot/robot.db"]
        database = self._root / "var/lib/msbot/robot.db"
        if not database.exists():
            made = ["/usr/lib/msbot/bin/msbot", "apply", "/etc/msbot/robot.toml", "--yes", "--db", str(database)]
            self._run(*made, user="msbot")
        adding = ("add", administrator.name, "--role", "administrator")
        if self._run(*user, *adding, *of_all, user="msbot", stdin=told) is not None:
            return ""
        refused = self._refused
        # When the power went before the file was wiped, the person is there already.
        changed_it = self._run(*user, "passwd", administrator.name, *of_all, user="msbot", stdin=told)
        return refused if changed_it is None else ""

    def _version(self) -> None:
        """Have the version that is in force where MsBOT is."""
        try:
            self.package.unlink(missing_ok=True)  # the power went while it came in
            now = self.store.begin()
        except (OSError, UpdateError) as error:
            say(f"the version cannot be put in force: {error}")
            return
        if now.current:
            place = str(self.store.place(now.current))
            self._run("mount", "--bind", place, "/usr/lib/msbot")
            self._run("mount", "-o", "remount,bind,ro,nosuid,nodev", "/usr/lib/msbot")

    @property
    def has_update_in_force(self) -> bool:
        """Whether an update is where MsBOT is, and not the version of the image."""
        return (self._root / "usr/lib/msbot").is_mount()

    def ends_of_master(self) -> int:
        """How often the master has ended and was started again since this start."""
        told = self._run("systemctl", "show", "--property", "NRestarts", "--value", "msbot-master.service")
        return int(told) if told is not None and told.strip().isdigit() else 0

    # Files of the system

    def _write(self, settings: Settings) -> None:
        etc = self._root / "etc"
        for name, text in {
            "hosts": system_files.hosts(settings),
            "issue": system_files.issue(settings),
            "msbot/can.env": system_files.can(settings),
            "msbot/master.env": self._master(settings),
        }.items():
            (etc / name).write_text(text, "utf-8")
        path = etc / "wpa_supplicant/wpa_supplicant-wlan0.conf"
        if settings.country:
            keep(path, system_files.wifi(settings).encode())
        else:
            path.unlink(missing_ok=True)

    @property
    def _bus_is_up(self) -> bool:
        flags = read(self._root / "sys/class/net/can0/flags", 32)
        return flags is not None and bool(int(flags, 16) & _IFF_UP)

    def _master(self, settings: Settings) -> str:
        # Whoever wrote a set-up file means to say who the administrator is: while it waits there with a mistake, a
        # stranger who opens the page first must not be.
        waits = os.path.lexists(self._boot / SETUP)
        return system_files.master(settings, bus_is_up=self._bus_is_up, is_open=not waits)

    def use_bus(self) -> None:
        """Write the master's options as bus and set-up file are; `msbot-master` does so before each start."""
        (self._root / "etc/msbot/master.env").write_text(self._master(self.settings()), "utf-8")

    def bus_came(self) -> None:
        """Have a master that runs already use a bus that has just come up."""
        text = (self._root / "etc/msbot/master.env").read_text("utf-8")
        if text != self._master(self.settings()):
            self._run("systemctl", "--no-block", "try-restart", "msbot-master.service")

    def _name(self, name: str) -> None:
        """Both: systemd's hostnamectl would go on with what /etc/hostname says."""
        (self._root / "etc/hostname").write_text(f"{name}\n", "utf-8")
        self._run("hostname", name)

    def _wifi(self, settings: Settings) -> None:
        if not (self._root / "sys/class/net/wlan0").exists():
            return
        self._run("systemctl", "restart" if settings.country else "stop", "wpa_supplicant@wlan0.service")

    def _edit_config(self, settings: Settings) -> None:
        text = read(self._boot / "config.txt", LARGEST_CONFIG)
        if text is not None and config_txt.edited(text.decode("utf-8", "replace"), settings).encode() != text:
            with Writable(self):
                self._write_config(settings)

    def _write_config(self, settings: Settings) -> None:
        path = self._boot / "config.txt"
        text = read(path, LARGEST_CONFIG)
        if text is None or len(text) > LARGEST_CONFIG:
            return
        new = config_txt.edited(text.decode("utf-8", "replace"), settings).encode()
        if new != text:
            keep(path, new)

    # For the page

    def state(self) -> dict[str, object]:
        """What the page shows; the key of the Wi-Fi is not among it."""
        settings, versions = asdict(self.settings()), asdict(self.store.versions())
        del versions["aside"]
        settings["has_key"] = bool(settings.pop("key"))
        trouble = read(self._boot / TROUBLE, LARGEST) or b""
        return {
            "settings": settings,
            "wifi": (self._root / "sys/class/net/wlan0").exists(),
            "can": (self._root / "sys/class/net/can0").exists(),
            "i2c": any((self._root / "dev").glob("i2c-*")),
            "mistakes": trouble.decode("utf-8", "replace"),
            "versions": versions,
        }

    def update(self, image: str) -> dict[str, object]:
        """Take in the package that the page has put there.

        Raises:
            UpdateError: it is no update.
        """
        mine = self._root / "data/card" / PACKAGE
        descriptor = os.open(self.package, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK)
        try:
            with os.fdopen(descriptor, "rb") as source, mine.open("wb") as target:
                about = os.fstat(source.fileno())
                if not stat.S_ISREG(about.st_mode) or about.st_size > LARGEST_PACKAGE:
                    raise UpdateError("the file is too large for an update")
                shutil.copyfileobj(source, target)
            self.store.take_in(mine, image)
        finally:
            mine.unlink(missing_ok=True)
        return self.state()

    def restart(self) -> None:
        """Start the computer again."""
        self._run("systemctl", "--no-block", "reboot")

    def grow(self) -> None:
        """Give the data partition the rest of the card."""
        mounts = (self._root / "proc/self/mounts").read_text("utf-8").splitlines()
        for line in mounts:
            device, place, *_ = line.split()
            if place == "/data" and growth.grow(Path(device).resolve()):
                say("the data partition has the rest of the card")

    def remount_boot(self, how: str) -> None:
        """Make the boot partition writable, or protect it again."""
        if self._boot.is_mount():
            self._run("mount", "-o", f"remount,{how}", str(self._boot))

    def _run(self, *command: str, user: str | None = None, stdin: str = "") -> str | None:
        """What a program of the system says; None: it fails, and `_refused` is why."""
        environment = {"PATH": "/usr/sbin:/usr/bin:/sbin:/bin", "LC_ALL": "C.UTF-8"}
        if user is not None:
            environment |= {"HOME": "/var/lib/msbot"}
        try:
            done = subprocess.run(
                command,
                input=stdin,
                capture_output=True,
                text=True,
                errors="replace",
                check=True,
                timeout=PROGRAM_S,
                env=environment,
                user=user,
                group=user,
                extra_groups=[] if user else None,
                umask=0o077 if user else -1,
                cwd="/",
            )
        except subprocess.CalledProcessError as error:
            self._refused = error.stderr.strip()[-500:]
            say(f"`{' '.join(command[:3])}` failed with {error.returncode}: {self._refused}")
            return None
        except subprocess.TimeoutExpired:
            self._refused = f"this computer needs more than {PROGRAM_S:.0f} s for it: start it again"
            say(f"`{' '.join(command[:3])}`: {self._refused}")
            return None
        return done.stdout


class Writable:
    """The boot partition, writable for a moment."""

    def __init__(self, system: System) -> None:
        self._system = system

    def __enter__(self) -> None:
        self._system.remount_boot("rw")

    def __exit__(self, *_: object) -> None:
        os.sync()
        self._system.remount_boot("ro")


def say(words: str) -> None:
    """Write into the log."""
    sys.stderr.write(json.dumps(words, ensure_ascii=False) + "\n" if "\n" in words else words + "\n")
    sys.stderr.flush()
