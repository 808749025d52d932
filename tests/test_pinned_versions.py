"""requirements/*.txt name everything that pyproject.toml asks for, in one version each, with hashes."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from tools.requirements import BUILD, EXTRAS

ROOT = Path(__file__).parent.parent
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
Pinned = dict[str, list[Requirement]]


def pinned(name: str) -> Pinned:
    """What a file names, several times where systems or Pythons differ; each line has a hash."""
    text = (ROOT / "requirements" / f"{name}.txt").read_text(encoding="utf-8").replace("\\\n", " ")
    found: Pinned = {}
    for line in text.splitlines():
        if line.startswith("#"):
            continue
        asked, *hashes = re.split(r"\s+--hash=", line.strip())
        assert hashes, f"requirements/{name}.txt: {asked} has no hash"
        assert all(re.fullmatch(r"sha256:[0-9a-f]{64}", one) for one in hashes), f"requirements/{name}.txt: {asked}"
        requirement = Requirement(asked)
        found.setdefault(canonicalize_name(requirement.name), []).append(requirement)
    return found


def asked_for(extras: tuple[str, ...]) -> list[Requirement]:
    """What pyproject.toml and the build ask for, with these extras and those that they name."""
    wanted = [*PROJECT["project"]["dependencies"], *PROJECT["build-system"]["requires"], *BUILD.split()]
    waiting = list(extras)
    while waiting:
        for text in PROJECT["project"]["optional-dependencies"][waiting.pop()]:
            requirement = Requirement(text)
            if requirement.name == PROJECT["project"]["name"]:
                waiting += requirement.extras
            else:
                wanted.append(text)
    return [Requirement(text) for text in wanted]


def version(requirement: Requirement) -> str:
    """The one version that a line names."""
    (only,) = requirement.specifier
    assert only.operator == "=="
    return only.version


@pytest.mark.parametrize("name", EXTRAS)
@pytest.mark.parametrize("python", ["3.11", "3.12", "3.13"])
@pytest.mark.parametrize("system", ["linux", "darwin", "win32"])
@pytest.mark.promise("What make installs is the file that the project was tested with, or the set-up says so")
def test_all_that_is_asked_for_is_named_with_a_version_that_fits(name: str, python: str, system: str) -> None:
    there = {"python_version": python, "python_full_version": f"{python}.9", "sys_platform": system}
    there |= {"platform_machine": "AMD64" if system == "win32" else "x86_64", "extra": ""}
    named = pinned(name)
    missing = []
    for asked in asked_for(EXTRAS[name]):
        if asked.marker and not asked.marker.evaluate(there):
            continue
        lines = named.get(canonicalize_name(asked.name), [])
        fitting = [line for line in lines if not line.marker or line.marker.evaluate(there)]
        if len(fitting) != 1 or not asked.specifier.contains(version(fitting[0])):
            missing.append(str(asked))
    assert missing == [], "call: make requirements"


def test_the_files_name_a_package_in_the_same_versions() -> None:
    files = [pinned(name) for name in EXTRAS]
    for package in files[0].keys() & files[1].keys() & files[2].keys():
        run, dev, docs = ({version(line) for line in file[package]} for file in files)
        assert run == dev == docs, package
