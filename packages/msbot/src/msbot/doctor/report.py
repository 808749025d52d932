"""What the doctor has seen, as a file that may be shown to others: `msbot doctor --report FILE`.

Secrets and people are left out twice: what is known here to be one (values of `msbot.json`, names of accounts and of
this computer) by its letters, and what has the form of one (tokens, keys, passwords in addresses) by its form.
"""

from __future__ import annotations

import getpass
import json
import platform
import re
import socket
import sys
from collections.abc import Collection, Iterable, Iterator
from importlib.metadata import PackageNotFoundError, requires, version
from pathlib import Path

from msbot.doctor.examination import Examination
from msbot.doctor.finding import Examined
from msbot.registry import open_registry
from msbot_agent.cli.build_name import version_words
from msbot_agent.process.user_folders import PACKAGES
from msbot_xrce.errors import MsbotError

OUT = "[left out]"
"""What stands in the place of a secret."""
SHORTEST = 3
"""Letters of a name that is looked for: shorter ones are in every word."""
LARGEST_BOARD_FILE = 65536
"""Octets of `msbot.json` that are looked through."""
_FORMS = (
    re.compile(r"\bmsbot_[A-Za-z0-9_-]{8,}(?=\W|$)"),  # API tokens
    re.compile(r"(?<=://)[^\s/@]+(?=@)"),  # user and password in an address
    re.compile(r"(?<=\btcp:)[^\s@/]+(?=@)"),  # password of a world
    re.compile(r"(?i)(?<=token=)[^\s&#\"']+|(?<=key=)[^\s&#\"']+|(?<=password=)[^\s&#\"']+|(?<=ticket=)[^\s&#\"']+"),
    re.compile(r"(?i)(?<=\bpassword )\S+|(?<=\bBearer )\S+"),
    re.compile(r"\b(?:[0-9A-Fa-f]{4}[-: ]){3,}[0-9A-Fa-f]{4}\b"),  # keys and UIDs as people write them
    re.compile(r"\b(?:[0-9A-Fa-f]{2}[-: ]){5,}[0-9A-Fa-f]{2}\b"),  # addresses of network cards
    re.compile(r"\b[0-9A-Fa-f]{16,}\b"),
    re.compile(r"\b[A-Za-z0-9_-]{40,}\b"),  # tokens of pages
    re.compile(r"[\w.+-]+@[\w-]+(?:\.[\w-]+)+"),  # people's addresses
)
_PUBLIC = re.compile(r"\b(?!(?:10|127|0)\.|192\.168\.|172\.(?:1[6-9]|2\d|3[01])\.|169\.254\.)(?:\d{1,3}\.){3}\d{1,3}\b")
"""Addresses in the internet; those of a room say nothing about whose room it is."""


class Scrubber:
    """Leaves secrets out of texts.

    Args:
        words: what is known to be one.
    """

    def __init__(self, words: Iterable[str]) -> None:
        known = sorted({word for word in words if len(word) >= SHORTEST}, key=len, reverse=True)
        self._known = re.compile("|".join(rf"(?<!\w){re.escape(word)}(?!\w)" for word in known)) if known else None

    def __call__(self, text: str) -> str:
        """The text without them."""
        clean = text.replace(str(Path.home()), "~") if len(str(Path.home())) >= SHORTEST else text
        if self._known is not None:
            clean = self._known.sub(OUT, clean)
        for form in (*_FORMS, _PUBLIC):
            clean = form.sub(OUT, clean)
        return clean


def report(patient: Examined, found: Examination, folders: Collection[Path]) -> str:
    """The file's text (Markdown).

    Args:
        patient: what was examined.
        found: what came of it.
        folders: where files of boards may lie, whose secrets are looked for.
    """
    scrub = Scrubber([*_of_computer(), *_of_boards(folders), *_of_robot(patient)])
    return scrub("\n".join(_lines(patient, found))) + "\n"


def _lines(patient: Examined, found: Examination) -> Iterator[str]:
    yield "# Report of msbot doctor"
    yield ""
    yield "Secrets and names of people are left out. Read it all the same before you show it to others."
    yield ""
    yield f"* {version_words()}"
    yield f"* Python {platform.python_version()} ({platform.python_implementation()}), {sys.platform}"
    yield f"* {platform.system()} {platform.release()} on {platform.machine()}"
    yield f"* packages: {', '.join(_packages())}"
    kind = "none" if patient.database is None else "PostgreSQL" if "://" in patient.database else "SQLite"
    yield f"* database: {kind}; links: {', '.join(link.partition(':')[0] for link in patient.links) or 'none'}"
    yield f"* masters and agents that run here: {len(patient.masters)}"
    yield ""
    yield "## What is to be mended"
    yield ""
    for check, finding in found.findings:
        note = "" if finding.must else " (a note)"
        yield f"* **{finding.about}** ({check}, {finding.problem}){note}: {finding.saw}"
        yield from (f"    * {words}" for words in (finding.why, finding.wire, finding.first, finding.mend) if words)
    if not found.findings:
        yield "Nothing."
    yield ""
    yield "## What else was looked at"
    yield ""
    yield f"* in order: {', '.join(found.well) or 'nothing'}"
    yield from (f"* not looked at: {check}: {why}" for check, why in found.not_seen)
    yield from (f"* not needed: {check}: {why}" for check, why in found.not_needed)


def _packages() -> Iterator[str]:
    """MsBOT's own packages, and what they need, as far as they are installed."""
    names: set[str] = set()
    for package in PACKAGES:
        own = package.replace("_", "-")
        try:
            lines = requires(own) or []
        except PackageNotFoundError:
            continue
        names |= {own, *(match[0] for line in lines if (match := re.match(r"[\w.-]+", line)))}
    for name in sorted(names):
        try:
            yield f"{name} {version(name)}"
        except PackageNotFoundError:
            continue


def _of_computer() -> Iterator[str]:
    """The computer's name and its user's."""
    yield socket.gethostname()
    yield socket.gethostname().partition(".")[0]
    try:
        yield getpass.getuser()
    except (OSError, KeyError):  # no account has this user's number
        return


def _of_boards(folders: Collection[Path]) -> Iterator[str]:
    """All values of files of boards: Wi-Fi, tokens, keys, UIDs."""
    for folder in folders:
        try:
            with (folder / "msbot.json").open(encoding="utf-8") as file:
                told = json.loads(file.read(LARGEST_BOARD_FILE))
        except (OSError, ValueError):
            continue  # there is none, or it has nothing that could be told
        if isinstance(told, dict):
            yield from _texts([value for name, value in told.items() if name != "link"])


def _texts(value: object) -> Iterator[str]:
    if isinstance(value, str):
        yield value
    elif isinstance(value, list):
        for one in value:
            yield from _texts(one)
    elif isinstance(value, dict):
        yield from _texts(list(value.values()))


def _of_robot(patient: Examined) -> Iterator[str]:
    """Names of the people who have an account."""
    if patient.database is None:
        return
    try:
        with open_registry(patient.database, read_only=True) as registry:
            yield from (user.name for user in registry.users.all())
    except MsbotError:
        return  # its findings tell; nothing of its content is in them
