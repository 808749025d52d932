"""What is found, what is loaded when, and what is left out; in this process, with invented packages."""

from __future__ import annotations

import logging
import sys
from pathlib import Path
from random import Random

import pytest

from msbot_agent.link import open_link
from msbot_agent.link.link_schemes import Scheme
from msbot_agent.startup import extensions as module
from msbot_agent.startup.extensions import Extension, Extensions, installed
from msbot_school.faults.packet_treatments import ErrorTolerantTreatment
from msbot_xrce.errors import ConfigError


def brought(name: str, found: object, group: str = "links", package: str = "a 1") -> Extension:
    def load() -> object:
        if isinstance(found, BaseException):
            raise found
        return found

    return Extension(group, name, package, "", load)


def test_what_is_wrong_is_left_out_and_said_once(caplog: pytest.LogCaptureFixture) -> None:
    good = Scheme("good:1", lambda rest, serve, can: open_link("udp:127.0.0.1:1"))
    found = Extensions(
        lambda: [
            brought("good", good),
            brought("missing", ModuleNotFoundError("x", name="x")),
            brought("text", "a text"),
            brought("exits", SystemExit(3)),
            brought("says", ConfigError("it needs a cable")),
            brought("udp", good),
            brought("good", good, package="b 1"),
            brought("odd", good, group="stops"),
            brought("raises", ValueError("\x1b[2J")),
            brought("../up", good),
        ]
    )
    for _ in range(2):
        assert found.all("links", Scheme, ["udp"]) == {"good": good}
    assert {(one.package, one.group, one.name): why for one, why in found.listed() if why} == {
        ("a 1", "links", "missing"): "there is no module 'x'",
        ("a 1", "links", "text"): "it is a str, not a Scheme",
        ("a 1", "links", "exits"): "SystemExit: 3",
        ("a 1", "links", "says"): "it needs a cable",
        ("a 1", "links", "udp"): "MsBOT itself has 'udp' there; give it another name",
        ("b 1", "links", "good"): "a 1 has 'good' already",
        ("a 1", "stops", "odd"): "MsBOT has no group msbot.stops; there are " + ", ".join(module.GROUPS),
        ("a 1", "links", "raises"): "ValueError: ?[2J",
        ("a 1", "links", "../up"): "a name has small letters, digits, - and _ only, and begins with a letter",
    }
    assert len(caplog.records) == 9
    assert all(record.levelno == logging.WARNING for record in caplog.records)


def test_each_is_loaded_when_it_is_needed_and_once() -> None:
    loaded = []

    def load() -> str:
        loaded.append(1)
        return "text"

    found = Extensions(lambda: [Extension("links", "one", "a 1", "", load)])
    assert list(found.names("links")) == ["one"]
    assert loaded == []
    assert found.get("links", "one", str) == found.get("links", "one", str) == "text"
    assert found.get("links", "two", str) is None
    assert loaded == [1]


def planted(folder: Path, name: str, points: str) -> None:
    info = folder / f"{name.replace('-', '_')}-1.dist-info"
    info.mkdir(parents=True)
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 1\nSummary: Says hello\n")
    (info / "entry_points.txt").write_text(points)


def test_packages_are_found_wherever_python_looks(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "path", [str(tmp_path / "near"), str(tmp_path / "far"), str(tmp_path / "none")])
    assert list(installed()) == []
    planted(tmp_path / "near", "of-others", "[console_scripts]\nx = x:y\n")
    planted(tmp_path / "far", "hello", "[msbot.links]\nfar = x:y\n[console_scripts]\nx = x:y\n")
    planted(tmp_path / "far", "also", "[msbot.checks]\nalso = no_such_module:y\n")
    assert sorted((one.package, one.group, one.name, one.summary) for one in installed()) == [
        ("also 1", "checks", "also", "Says hello"),
        ("hello 1", "links", "far", "Says hello"),
    ]
    planted(tmp_path / "near", "hello", "[msbot.links]\nnear = x:y\n")
    assert sorted(one.name for one in installed()) == ["also", "near"], "the nearer one hides the other"


def test_what_msbot_brings_itself_is_no_extension() -> None:
    stranger, other = brought("demo", "theirs", "commands"), brought("x", "theirs", "loaders")
    own = brought("demo", "ours", "commands", "msbot-web 1"), brought("x", "ours", "loaders", "msbot-web 1")
    found = Extensions(lambda: [stranger, other, *own])
    assert found.all("commands", str, ["demo"]) == {"demo": "ours"}
    assert found.all("loaders", str) == {"x": "ours"}
    assert {(one.package, one.group) for one, why in found.listed() if why} == {("a 1", "commands"), ("a 1", "loaders")}
    broken = Extensions(lambda: [brought("page", ImportError("no nicegui"), "services", "msbot-web 1"), own[0]])
    assert broken.all("services", object) == {}
    assert [(one.package, one.name, why) for one, why in broken.listed()] == [
        ("msbot-web 1", "page", "ImportError: no nicegui")
    ]


def test_octets_that_are_no_text_do_no_harm(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "path", [str(tmp_path)])
    planted(tmp_path, "good", "[msbot.links]\nfar = x:y\n")
    bad = tmp_path / "bad-1.dist-info"
    bad.mkdir()
    (bad / "METADATA").write_bytes(b"Name: bad\nVersion: \xff\n")
    (bad / "entry_points.txt").write_bytes(b"[msbot.links]\n\xff\xfe = ]]]\n")
    assert [one.name for one in installed() if one.package == "good 1"] == ["far"]


class WithoutFreeAt:
    """A treatment of packets that is not complete."""

    def __init__(self, amount: float, chance: Random) -> None:
        self.amount, self.chance = amount, chance

    def delays(self, peer: object, now: float, *, inward: bool) -> list[float]:
        raise NotImplementedError


class Old:
    """Has neither of the methods."""

    def __init__(self, amount: float, chance: Random) -> None:
        self.amount, self.chance = amount, chance

    def waits(self, peer: object, now: float, *, inward: bool) -> list[float]:
        raise NotImplementedError


def test_a_fault_names_the_methods_that_are_missing() -> None:
    for made, words in (
        (WithoutFreeAt, "the class WithoutFreeAt has no free_at()"),
        (Old, "the class Old has no delays() and no free_at()"),
    ):
        with pytest.raises(ConfigError) as caught:
            ErrorTolerantTreatment("tired", made, 1.0, Random(1))
        assert str(caught.value) == f"the extension that brings the fault tired failed: TypeError: {words}"
