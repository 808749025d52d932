"""Mistakes in drivers that others write: each is a sentence, at the part and in its robot."""

from __future__ import annotations

import logging
from pathlib import Path

import pytest

from msbot.config import Library, load_library
from msbot.hardware import Driver, HardwareParts, Values, driver_class, make_wiring
from msbot.part import JoinState
from msbot_xrce.errors import ConfigError
from tests.hardware import robot
from tests.hardware.robot import Bench, machine_at, play


class Slip(Driver):
    """Reads `usd` in place of `used`."""

    samples = True

    def sample(self, values: Values) -> Values:
        return {"usd": 42.0}


class ReadsMore(Driver):
    """Reads more than the type uses."""

    samples = True

    def sample(self, values: Values) -> Values:
        return {"used": 42.0, "free": 58.0}


class Divides(Driver):
    """Has a mistake that shows in its third sample."""

    samples = True
    count = 0

    def sample(self, values: Values) -> Values:
        self.count += 1
        return {"used": 1.0 / max(0, 3 - self.count)}


class NeverReads(Driver):
    """Has a mistake that shows in its first sample."""

    samples = True

    def sample(self, values: Values) -> Values:
        return {"used": dict[str, float]()["none"]}


class WithoutSample(Driver):
    """Says that it reads, and does not."""

    samples = True


class WithoutDrive(Driver):
    """Says that it switches, and does half of it."""

    drives = True

    def outputs_for(self, values: Values) -> object:
        return values["used"]


class Unsaid(Driver):
    """Reads, and does not say so."""

    def sample(self, values: Values) -> Values:
        return values


class WrongSource(Driver):
    """Switches by `usd` in place of `used`."""

    drives = True

    def outputs_for(self, values: Values) -> object:
        return values["usd"]

    def drive(self, wanted: object) -> None:
        raise AssertionError(wanted)


class Reads(Slip):
    """Is complete: it inherits both."""


DISK = """
number = "DISK-1"
name = "Disk meter"
category = "sensor"
supply = {}
port = [{ name = "used", direction = "publish", type = "Level" }]
driver = { class = "%s", bus = "kernel" }
[simulator]
control = [{ name = "used", type = "number", start = 1, min = 0, max = 100 }]
publish = [{ port = "used", every = 1, fields = { percent = "used" } }]
"""


def library(folder: Path, entry_point: str) -> Library:
    (folder / "DISK-1.toml").write_text(DISK % entry_point)
    return load_library(folder)


def refused(folder: Path, entry_point: str) -> str:
    with pytest.raises(ConfigError) as caught:
        driver_class(library(folder, entry_point).require("DISK-1"))
    return str(caught.value)


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("WithoutSample", "has samples = True, but no sample(); write it"),
        ("WithoutDrive", "has drives = True, but no drive(); write it"),
        ("Unsaid", "has sample(), which is never called; write samples = True into the class"),
    ],
)
def test_a_driver_that_is_not_complete(name: str, words: str, tmp_path: Path) -> None:
    entry_point = f"{__name__}:{name}"
    assert refused(tmp_path, entry_point) == f"the driver {entry_point} {words}"


def test_a_driver_that_cannot_be_loaded(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    words = refused(tmp_path, f"{__name__}:NoSuch")
    assert "of part DISK-1 cannot be found" in words
    assert "'NoSuch'" in words
    (tmp_path / "raises_at_once.py").write_text("1 / 0\n")
    monkeypatch.syspath_prepend(tmp_path)
    words = refused(tmp_path, "raises_at_once:Disk")
    assert words.endswith("of part DISK-1 cannot be loaded: ZeroDivisionError: division by zero")


def test_every_driver_of_msbot_and_what_inherits_all_is_complete(tmp_path: Path) -> None:
    types = [part_type for part_type in load_library() if part_type.driver.entry_point]
    assert len(types) > 40
    for part_type in types:
        assert issubclass(driver_class(part_type), Driver)
    assert driver_class(library(tmp_path, f"{__name__}:Reads").require("DISK-1")) is Reads


def test_a_reading_of_a_wrong_name_is_said_once_at_the_part_and_in_why(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(robot, "LIBRARY", library(tmp_path, f"{__name__}:Slip"))
    words = "the driver reads 'usd', but the part type has no such control or reading; did you mean used?"
    seen = list[str]()

    async def scene(bench: Bench) -> None:
        await bench.until(lambda: len(bench.heard["used"]) > 3)
        assert bench.unit.part.state is JoinState.ACTIVE
        seen.extend(line for slot in bench.master.inventory.slots.names() for line in bench.master.why(slot))

    with caplog.at_level(logging.WARNING, "msbot.part"):
        play("DISK-1", machine_at(tmp_path), scene)
    (record,) = [record for record in caplog.records if "usd" in record.getMessage()]
    assert record.getMessage() == f"DISK-1: {words}"
    assert record.levelno == logging.ERROR, "the journal, and with it `msbot why` and `msbot parts`, has only errors"
    assert f"its program says: {words}" in seen


def test_a_reading_that_a_type_does_not_use_is_no_error(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(robot, "LIBRARY", library(tmp_path, f"{__name__}:ReadsMore"))

    async def scene(bench: Bench) -> None:
        await bench.until(lambda: len(bench.heard["used"]) > 3)
        assert bench.last("used")["percent"] == 42.0

    with caplog.at_level(logging.WARNING, "msbot.part"):
        play("DISK-1", machine_at(tmp_path), scene)
    (record,) = [record for record in caplog.records if "'free'" in record.getMessage()]
    assert record.levelno == logging.WARNING


def test_a_driver_that_needs_a_source_that_is_not_there_keeps_its_part_out_and_says_why(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(robot, "LIBRARY", library(tmp_path, f"{__name__}:WrongSource"))
    words = "the driver needs the value 'usd', but the part type has no such source; did you mean used?"
    seen = list[str]()

    async def scene(bench: Bench) -> None:
        def why() -> list[str]:
            parts = [info.part for info in bench.master.inventory.view(0.0)]
            return [line for part in parts for line in bench.master.why(part, by_name=True)]

        await bench.until(lambda: any(words in line for line in why()))
        seen.extend(why())
        assert bench.unit.part.state is not JoinState.ACTIVE

    assert play("DISK-1", machine_at(tmp_path), scene, joins=False).unit.fault == words
    assert seen


@pytest.mark.parametrize(
    ("name", "mistake"), [("Divides", "ZeroDivisionError: float division by zero"), ("NeverReads", "KeyError: 'none'")]
)
def test_an_exception_of_a_driver_is_said_in_the_robot_with_its_traceback_once_in_the_log(
    name: str, mistake: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(robot, "LIBRARY", library(tmp_path, f"{__name__}:{name}"))

    async def scene(bench: Bench) -> None:
        def why() -> str:
            parts = [info.part for info in bench.master.inventory.view(0.0)]
            return "".join(line for part in parts for line in bench.master.why(part, by_name=True))

        await bench.until(lambda: "the driver failed in line" in why() and mistake in why())
        assert bench.unit.part.state is not JoinState.ACTIVE

    with caplog.at_level(logging.WARNING, "msbot.part"):
        play("DISK-1", machine_at(tmp_path), scene, joins=name == "Divides")
    assert sum(record.exc_info is not None for record in caplog.records) == 1
    assert not [record for record in caplog.records if record.name == "asyncio"]


def test_a_mistake_is_told_before_anything_is_opened(tmp_path: Path) -> None:
    part_type = library(tmp_path, f"{__name__}:WithoutSample").require("DISK-1")
    bench = HardwareParts(machine_at(tmp_path))
    try:
        with pytest.raises(ConfigError, match=r"no sample\(\)"):
            bench.make(part_type, make_wiring(part_type))
    finally:
        bench.end()
