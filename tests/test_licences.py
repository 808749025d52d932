"""What MsBOT is installed with, its extras included, has licences that go together with Apache-2.0. Offline."""

from __future__ import annotations

import re
import tomllib
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

FREE = (
    "apache", "mit", "mit-0", "mit-cmu", "bsd", "0bsd", "isc", "psf", "python software foundation", "unlicense", "zlib",
    "cc0", "mpl", "mozilla public",
)  # fmt: skip
"""Beginnings of words of licences that ask for no more than a notice, or (MPL) for changes to their own files."""
ALLOWED = {
    "apsw": "the zlib licence, which it tells as any-OSI",
    "psycopg": "LGPL: used as it is, and can be exchanged: the extra `postgres` installs it",
    "psycopg-binary": "LGPL: as psycopg",
    "python-can": "LGPL: used as it is, and can be exchanged: the extra `can` installs it",
    "zeroconf": "LGPL: used as it is, and can be exchanged: the extra `announce` installs it",
    "paho-mqtt": "EPL-2.0 or EDL (BSD-3-Clause): the latter",
    "cyclonedds": "EPL-2.0 or EDL (BSD): the latter",
    "eclipse-zenoh": "EPL-2.0 or Apache-2.0: the latter",
    "docutils": "public domain and BSD; of its files only an Emacs mode, which nobody imports, has the GPL",
}
"""Others, each with the reason why it may be used."""


def names_of_licence(package: str) -> list[str]:
    """What a package says its licence is: the expression, or else the classifiers, or else the text."""
    told = distribution(package).metadata
    if expressions := told.get_all("License-Expression"):
        return re.split(r"\s+(?:AND|OR)\s+|[()]", expressions[0])
    if classifiers := [one.split(" :: ")[-1] for one in told.get_all("Classifier") or [] if one.startswith("License")]:
        return [one for one in classifiers if one not in ("OSI Approved", "DFSG approved")]
    return [" ".join(told.get_all("License") or ["nothing"]).strip()]


def is_free(licence: str) -> bool:
    return licence.strip().lower().removeprefix("the ").startswith(FREE) or not licence.strip()


def installed() -> set[str]:
    """MsBOT's dependencies, with all extras, as far as they are installed here."""
    found: set[str] = set()
    waiting = [("msbot", tuple(distribution("msbot").metadata.get_all("Provides-Extra") or ()))]
    workspace = tomllib.loads((Path(__file__).parents[1] / "pyproject.toml").read_text(encoding="utf-8"))
    waiting += [(one.name, tuple(one.extras)) for one in map(Requirement, workspace["dependency-groups"]["dev"])]
    while waiting:
        package, extras = waiting.pop()
        try:
            wanted = distribution(package).requires or []
        except PackageNotFoundError:
            continue  # an extra that is not installed here; CI has all
        found.add(canonicalize_name(package))
        for one in map(Requirement, wanted):
            is_wanted = one.marker is None or any(one.marker.evaluate({"extra": extra}) for extra in ("", *extras))
            if is_wanted and canonicalize_name(one.name) not in found:
                waiting.append((one.name, tuple(one.extras)))
    return {name for name in found if name != "msbot" and not name.startswith("msbot-")}


def test_every_dependency_has_a_licence_that_may_be_used() -> None:
    packages = installed()
    assert {"click", "pytest", "fastapi", "sqlalchemy"} <= packages
    others = {
        package: words
        for package in packages
        if package not in ALLOWED and not all(map(is_free, words := names_of_licence(package)))
    }
    assert not others, "look whether these may be used; if so, write the reason into ALLOWED"


def test_licences_that_ask_for_more_are_told_apart() -> None:
    for licence in ("GPL-3.0-only", "LGPL-3.0-only", "AGPL-3.0", "Proprietary", "nothing", "EPL-2.0", "SSPL"):
        assert not is_free(licence)
    for licence in ("MIT", "Apache Software License", "BSD-3-Clause", "Mozilla Public License 2.0 (MPL 2.0)"):
        assert is_free(licence)


def test_no_reason_is_kept_for_what_is_not_used() -> None:
    for package in ALLOWED.keys() & installed():
        assert not all(map(is_free, names_of_licence(package))), f"{package} needs no reason any more"
