"""Facts about Python, packages and permissions."""

from __future__ import annotations

import contextlib
import getpass
import importlib.metadata
import os
import re
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from msbot.doctor.facts import AccessFacts, Device, PackageNeed, PythonFacts
from msbot.doctor.finding import CannotSee, Examined
from msbot_agent.text.sentence import said

if TYPE_CHECKING:
    from packaging.markers import Marker

NEWEST = (3, 13)
"""Newest Python that MsBOT was tried with; the classifiers of pyproject.toml say the same."""
OLDEST = (3, 11)
DEVICES = ("ttyUSB*", "ttyACM*", "ttyAMA*", "serial*", "gpiochip*", "i2c-*", "spidev*")
PYTHON_CAN = re.compile(r"[^:?]+:[^?]")
"""`slcan:/dev/ttyACM0`: an interface of python-can; one of Linux (`can0`) needs no package."""


def python(_: Examined) -> PythonFacts:
    """The interpreter."""
    version = sys.version_info
    return PythonFacts(
        (version.major, version.minor, version.micro), sys.maxsize > 2**32, sys.executable, OLDEST, NEWEST
    )


def packages(patient: Examined) -> tuple[PackageNeed, ...]:
    """The packages that are needed for what is wanted."""
    try:
        import packaging.requirements  # noqa: F401
    except ImportError:
        raise CannotSee(said("it needs a package: pip install packaging")) from None
    try:
        return tuple(_needs("msbot", ["", *wanted_extras(patient)]))
    except importlib.metadata.PackageNotFoundError:
        raise CannotSee(said("MsBOT is not installed as a package here")) from None


def _needs(distribution: str, extras: list[str]) -> Iterator[PackageNeed]:
    """What a distribution of MsBOT needs with these extras (empty: without any).

    An extra may be one of a lower distribution: `msbot[serial]` is `msbot-agent[serial]`, which needs serialx.
    """
    from packaging.requirements import Requirement

    for line in importlib.metadata.requires(distribution) or []:
        need = Requirement(line)
        extra = next((one for one in extras if _is_wanted(need.marker, one)), None)
        if extra is None:
            continue
        try:
            installed = importlib.metadata.version(need.name)
        except importlib.metadata.PackageNotFoundError:
            installed = None
        fits = installed is not None and need.specifier.contains(installed, prereleases=True)
        if not need.name.startswith("msbot"):
            brought_by = f"{distribution}[{extra}]" if extra else ""
            yield PackageNeed(need.name, str(need.specifier), brought_by, installed, fits)
        elif installed is None or not fits:
            yield PackageNeed(need.name, str(need.specifier), "", installed, fits)
        elif need.extras or not extra:
            yield from _needs(need.name, sorted(need.extras) or [""])


def _is_wanted(marker: Marker | None, extra: str) -> bool:
    """Whether a package belongs to an extra (empty: to MsBOT itself) on this computer."""
    return not extra if marker is None else marker.evaluate({"extra": extra})


def wanted_extras(patient: Examined) -> list[str]:
    """The extras that links and database need; DDS has a check of its own, since it may come from the system."""
    extras = {"serial" for _ in patient.of_kind("serial")}
    extras |= {
        "can" for kind in ("can", "canfd", "can-legacy") for rest in patient.of_kind(kind) if PYTHON_CAN.match(rest)
    }
    if patient.database is not None:
        extras.add("master")
        if "://" in patient.database and not patient.database.startswith("sqlite"):
            extras.add("postgres")
    return sorted(extras)


def access(_: Examined) -> AccessFacts:
    """Who runs this, and what they may use."""
    try:
        import grp
        import pwd
    except ImportError:
        raise CannotSee(said("this system has no groups")) from None
    user = getpass.getuser()
    groups = set()
    for number in {*os.getgroups(), os.getegid()}:
        try:
            groups.add(grp.getgrgid(number).gr_name)
        except KeyError:
            continue  # a group of another system, as in containers
    member_of = {group.gr_name for group in grp.getgrall() if user in group.gr_mem}
    with contextlib.suppress(KeyError):  # a user without an entry, as in containers
        member_of.add(grp.getgrgid(pwd.getpwnam(user).pw_gid).gr_name)
    return AccessFacts(user, frozenset(groups), frozenset(member_of), tuple(_devices(Path("/dev"))))


def _devices(folder: Path) -> Iterator[Device]:
    import grp

    for pattern in DEVICES:
        for path in sorted(folder.glob(pattern)):
            try:
                group = grp.getgrgid(path.stat().st_gid).gr_name
            except KeyError:
                group = ""
            except OSError:
                continue  # unplugged at this moment
            yield Device(str(path), group, os.access(path, os.R_OK | os.W_OK))
