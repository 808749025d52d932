"""Python, packages, permissions."""

from __future__ import annotations

from collections.abc import Iterator

from msbot.doctor.facts import AccessFacts, PackageNeed, PythonFacts
from msbot.doctor.finding import Finding
from msbot_agent.text.sentence import said

NOTHING_ON_THE_WIRE = said("nothing: the program ends before it sends")


def check_python(facts: PythonFacts) -> Iterator[Finding]:
    """Whether MsBOT runs with this Python."""
    version = ".".join(map(str, facts.version))
    about = facts.executable
    oldest, newest = (".".join(map(str, one)) for one in (facts.oldest, facts.newest))
    if facts.version[:2] < facts.oldest:
        yield Finding(
            "python-old",
            about,
            said("this is Python {version}; {oldest} is the oldest that will do", version=version, oldest=oldest),
            said("MsBOT and its packages use what older ones do not have: they end with errors of syntax"),
            NOTHING_ON_THE_WIRE,
            f"sudo apt install python{newest}-venv && python{newest} -m venv .venv",
        )
    elif facts.version[:2] > facts.newest:
        yield Finding(
            "python-new",
            about,
            said(
                "this is Python {version}; MsBOT was tried with {oldest} to {newest}",
                version=version,
                oldest=oldest,
                newest=newest,
            ),
            said("packages with parts in C, such as that of DDS, may have no build for it yet"),
            NOTHING_ON_THE_WIRE,
            f"sudo apt install python{newest}-venv && python{newest} -m venv .venv",
            must=False,
        )
    if not facts.is_64_bit:
        yield Finding(
            "python-32-bit",
            about,
            said("this Python has 32 bits"),
            said(
                "there are no ready-made packages for DDS and pages of the robot on it: they must be compiled, "
                "which takes hours"
            ),
            NOTHING_ON_THE_WIRE,
            "uname -m  # aarch64 or x86_64: install a system of 64 bits",
            must=False,
        )


def check_packages(needs: tuple[PackageNeed, ...]) -> Iterator[Finding]:
    """Whether the packages are there."""
    for need in needs:
        # MsBOT itself is in no package index: pip is asked only for what others have published.
        by_hand = f"msbot --version  # install {need.name}{need.wanted} from the folder of MsBOT or its wheels"
        is_own = need.name.startswith("msbot")
        install = f"pip install '{need.extra or need.name + need.wanted}'"
        if need.installed is None:
            yield Finding(
                "package-missing",
                need.name,
                said("the package {name} is not installed", name=need.name),
                said("what is asked for needs it, and ends with an error without it"),
                NOTHING_ON_THE_WIRE,
                by_hand if is_own else install,
            )
        elif not need.fits:
            yield Finding(
                "package-version",
                need.name,
                said(
                    "{name} is here in version {installed}, and {wanted} is needed",
                    name=need.name,
                    installed=need.installed,
                    wanted=need.wanted,
                ),
                said("other versions lack what MsBOT calls, or do it in another way"),
                NOTHING_ON_THE_WIRE,
                by_hand if is_own else f"pip install --upgrade '{need.name}{need.wanted}'",
            )


def check_access(facts: AccessFacts) -> Iterator[Finding]:
    """Whether this user may use the devices there are."""
    shut: dict[str, list[str]] = {}
    for device in facts.devices:
        if not device.is_usable:
            shut.setdefault(device.group, []).append(device.path)
    for group, paths in shut.items():
        devices = ", ".join(paths)
        wire = said("nothing: the device is never opened")
        if group in facts.member_of - facts.groups:
            yield Finding(
                "group-not-in-force",
                devices,
                said(
                    "{user} is in the group {group}, and this login does not know it yet", user=facts.user, group=group
                ),
                said("groups hold from the next login on: until then {devices} cannot be opened", devices=devices),
                wire,
                f"newgrp {group}",
                first=said("log out and in again, or restart the computer"),
            )
        elif group in ("", "root"):
            yield Finding(
                "device-of-root",
                devices,
                said("only root may use {devices}", devices=devices),
                said("no rule of udev gives it to a group: parts behind it cannot be reached"),
                wire,
                f"sudo chmod a+rw {' '.join(paths)}",
            )
        else:
            yield Finding(
                "group-missing",
                devices,
                said(
                    "{user} may not use {devices}: it belongs to the group {group}",
                    user=facts.user,
                    devices=devices,
                    group=group,
                ),
                said("parts and buses behind it cannot be reached"),
                wire,
                f"sudo usermod -aG {group} {facts.user}",
                first=said("afterwards, log out and in again"),
            )
