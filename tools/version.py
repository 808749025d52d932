"""The version: the same in all distributions, in the boards' package, and in the docs. It is set in one place, here.

python tools/version.py            prints it, or says where it differs (status 1)
python tools/version.py 0.2.0      writes it everywhere, and begins its section in CHANGELOG.md
"""

from __future__ import annotations

import re
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

from tools.sources import PACKAGES, ROOT

OWN = "|".join(package.parents[1].name for package in PACKAGES)
FORM = re.compile(r"\d+\.\d+\.\d+(?:(?:a|b|rc)\d+)?")
"""A version that both pip and semantic versioning can order."""
PLACES = (
    ("packages/*/pyproject.toml", re.compile(r'^(version = ")([^"]+)(")$', re.MULTILINE)),
    ("packages/*/pyproject.toml", re.compile(rf'("(?:{OWN})(?:\[[\w,-]+\])?==)([^";]+)(")')),
    ("micropython/msbot/__init__.py", re.compile(r'^(__version__ = ")([^"]+)(")$', re.MULTILINE)),
    ("packages/msbot/src/msbot/part/join/home.py", re.compile(r'^(VERSION: Final = ")([^"]+)(")$', re.MULTILINE)),
    ("firmware/c/msbot_part.h", re.compile(r'^(#define MSBOT_VERSION ")([^"]+)(")$', re.MULTILINE)),
    ("docs/howto/*.md", re.compile(r"(\bmsbot(?:_agent|_xrce)?-)(\d[\w.]*)(-py3-none-any\.whl)")),
    ("docs/howto/*.md", re.compile(r"(\bmsbot-)(\d[\w.]*)(\.cdx\.json)")),
    ("docs/howto/*.md", re.compile(r"(\bmsbot_)(\d[\w.]*)(_(?:amd64|arm64)\.deb)")),
)
"""Files, and what stands before and behind the version in them."""


class VersionError(Exception):
    """The version is not the same everywhere, or no version; the text says where."""


def found(root: Path = ROOT) -> dict[str, set[str]]:
    """Where each version stands."""
    versions: dict[str, set[str]] = {}
    for files, form in PLACES:
        for path in sorted(root.glob(files)):
            for match in form.finditer(path.read_text("utf-8")):
                versions.setdefault(match[2], set()).add(str(path.relative_to(root)))
    return versions


def read(root: Path = ROOT) -> str:
    """The version.

    Raises:
        VersionError: the places differ.
    """
    versions = found(root)
    if len(versions) != 1:
        differing = "; ".join(f"{version} in {', '.join(sorted(places))}" for version, places in versions.items())
        raise VersionError(
            f"the version is not the same everywhere: {differing}. Call: python tools/version.py VERSION"
        )
    return next(iter(versions))


def write(version: str, root: Path = ROOT) -> None:
    """Set it everywhere; the changelog gets its section, which takes what is under Unreleased.

    Raises:
        VersionError: it has not the form of a version.
    """
    if not FORM.fullmatch(version):
        raise VersionError(f"{version!r} is no version: three numbers, as 0.2.0, and behind them perhaps rc1")
    for files, form in PLACES:
        for path in root.glob(files):
            text = path.read_text("utf-8")
            path.write_text(form.sub(lambda match: f"{match[1]}{version}{match[3]}", text), "utf-8")
    changelog = root / "CHANGELOG.md"
    text = changelog.read_text("utf-8")
    if f"## [{version}]\n" not in text:
        changelog.write_text(text.replace("## [Unreleased]\n", f"## [Unreleased]\n\n## [{version}]\n", 1), "utf-8")


def section(version: str, changelog: str) -> str:
    """What the changelog says of a version.

    Raises:
        VersionError: nothing.
    """
    match = re.search(rf"^## \[{re.escape(version)}\]\n(.*?)(?=^## \[|\Z)", changelog, re.MULTILINE | re.DOTALL)
    if match is None or not match[1].strip():
        raise VersionError(f"CHANGELOG.md has nothing under `## [{version}]`: say there what this version brings")
    return match[1].strip() + "\n"


def main(*arguments: str) -> int:
    """Print or set it."""
    try:
        if arguments:
            write(arguments[0])
        sys.stdout.write(f"{read()}\n")
    except VersionError as error:
        sys.stderr.write(f"{error}\n")
        return 1
    return 0


if __name__ == "__main__":
    raise SystemExit(main(*sys.argv[1:]))
