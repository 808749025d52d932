"""What MsBOT consists of, as a bill of materials (CycloneDX 1.6): its distributions, what they need, what they carry.

Packages and hashes are those of requirements/dev.txt, as far as `msbot[all]` needs them; licences are what the packages
installed here say. The same commit gives the same file.
"""

from __future__ import annotations

import json
import re
import tomllib
from collections.abc import Iterator
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path
from uuid import NAMESPACE_URL, uuid5

from cyclonedx.contrib.license.factories import LicenseFactory
from cyclonedx.model import HashAlgorithm, HashType, Property
from cyclonedx.model.bom import Bom
from cyclonedx.model.component import Component, ComponentType
from cyclonedx.model.license import License
from cyclonedx.output.json import JsonV1Dot6
from packageurl import PackageURL
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from tools.release.building import DISTRIBUTIONS, sha256
from tools.sources import ROOT

_LICENCES = {
    "MIT License": "MIT",
    "BSD License": "BSD-3-Clause",
    "Apache Software License": "Apache-2.0",
    "Mozilla Public License 2.0 (MPL 2.0)": "MPL-2.0",
    "Python Software Foundation License": "PSF-2.0",
    "ISC License (ISCL)": "ISC",
}
"""Classifiers that mean one licence, with its SPDX name. `BSD License` names a family: the file in the wheel tells."""


def bill(version: str, commit: str, epoch: int, wheels: list[Path]) -> str:
    """The bill in JSON."""
    bom = Bom(serial_number=uuid5(NAMESPACE_URL, f"msbot:{version}:{commit}"))
    bom.metadata.timestamp = datetime.fromtimestamp(epoch, UTC)
    robot = Component(name="msbot", version=version, type=ComponentType.APPLICATION, bom_ref="msbot-release")
    robot.licenses.add(_licence("Apache-2.0"))
    robot.properties.add(Property(name="msbot:commit", value=commit))
    bom.metadata.component = robot
    own = {name: _own(name, version, wheels) for name in DISTRIBUTIONS}
    pairs, carried = list(_others()), list(_carried())
    others = dict(pairs)
    for component in (*own.values(), *(component for _, component in pairs), *carried):
        bom.components.add(component)
    bom.register_dependency(robot, own.values())
    for name, component in own.items():
        needed = {canonicalize_name(one.name) for one in map(Requirement, _asked_by(name))} - {name}
        brought = carried if name == "msbot-web" else []
        both = own | others
        bom.register_dependency(component, [*(both[one] for one in sorted(needed) if one in both), *brought])
    return json.dumps(json.loads(JsonV1Dot6(bom).output_as_string()), indent=2, sort_keys=True) + "\n"


def pins(requirements: Path = ROOT / "requirements" / "dev.txt") -> dict[str, list[tuple[str, list[str]]]]:
    """By package: versions (several where systems differ) and the SHA-256 of their files."""
    found: dict[str, list[tuple[str, list[str]]]] = {}
    for line in requirements.read_text("utf-8").replace("\\\n", " ").splitlines():
        if match := re.match(r"([\w.-]+)==([^\s;]+)", line):
            hashes = re.findall(r"--hash=sha256:([0-9a-f]{64})", line)
            found.setdefault(canonicalize_name(match[1]), []).append((match[2], hashes))
    return found


def _asked_by(name: str) -> list[str]:
    project = tomllib.loads((ROOT / "packages" / name / "pyproject.toml").read_text("utf-8"))["project"]
    extras = project.get("optional-dependencies", {})
    return [*project["dependencies"], *(one for extra in extras.values() for one in extra)]


def _needed() -> set[str]:
    """All that `msbot[all]` needs, as the packages installed here say."""
    found: set[str] = set()
    waiting = [one for name in DISTRIBUTIONS for one in _asked_by(name)]
    while waiting:
        one = Requirement(waiting.pop())
        name = canonicalize_name(one.name)
        if name in found or name in DISTRIBUTIONS:
            continue
        found.add(name)
        try:
            asked = distribution(name).requires or []
        except PackageNotFoundError:
            continue  # for another system
        extras = ("", *one.extras)
        waiting += [
            str(each)
            for each in map(Requirement, asked)
            if each.marker is None or any(each.marker.evaluate({"extra": extra}) for extra in extras)
        ]
    return found


def _others() -> Iterator[tuple[str, Component]]:
    pinned = pins()
    for name in sorted(_needed() & pinned.keys()):
        for version, hashes in pinned[name]:
            component = Component(
                name=name,
                version=version,
                type=ComponentType.LIBRARY,
                purl=PackageURL("pypi", None, name, version),
                bom_ref=f"{name}@{version}",
            )
            if words := _licence_of(name):
                component.licenses.add(_licence(words))
            for value in hashes:  # a component has one file in CycloneDX; a package has one a system
                component.properties.add(Property(name="msbot:file-sha256", value=value))
            yield name, component


def _own(name: str, version: str, wheels: list[Path]) -> Component:
    (wheel,) = (path for path in wheels if path.name.startswith(f"{name.replace('-', '_')}-"))
    component = Component(
        name=name,
        version=version,
        type=ComponentType.LIBRARY,
        purl=PackageURL("pypi", None, name, version),
        bom_ref=f"{name}@{version}",
        hashes=[HashType(alg=HashAlgorithm.SHA_256, content=sha256(wheel))],
    )
    component.licenses.add(_licence("Apache-2.0"))
    return component


def _carried() -> Iterator[Component]:
    """Files of others for the browser: in the wheels, and in the site of the docs."""
    in_wheels = sorted((ROOT / "packages/msbot-web/src").rglob("static/*/manifest.json"))
    for manifest in (*in_wheels, ROOT / "tools/tab_page/manifest.json"):
        told = json.loads(manifest.read_text("utf-8"))
        group, _, name = told["package"].rpartition("/")
        component = Component(
            name=name,
            group=group or None,
            version=told["version"],
            type=ComponentType.LIBRARY,
            purl=PackageURL("npm", group or None, name, told["version"]),
            bom_ref=f"{told['package']}@{told['version']}",
        )
        component.licenses.add(_licence(told["licence"]))
        for value in told["files"].values():
            component.properties.add(Property(name="msbot:file-sha256", value=value))
        yield component


def _licence_of(name: str) -> str:
    try:
        told = distribution(name).metadata
    except PackageNotFoundError:
        return ""
    if expression := told.get_all("License-Expression"):
        return str(expression[0])
    classifiers = [one.split(" :: ")[-1] for one in told.get_all("Classifier") or [] if one.startswith("License")]
    if named := [_LICENCES.get(one, one) for one in classifiers if one != "OSI Approved"]:
        return " OR ".join(named) if all(one in _LICENCES.values() for one in named) else "; ".join(named)
    return str((told.get_all("License") or [""])[0]).strip().split("\n")[0]


def _licence(words: str) -> License:
    """A licence, or an expression of several; what is neither is kept as a name."""
    return LicenseFactory().make_from_string(words)
