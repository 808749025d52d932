"""The pages of hardware say what the part types say, and every driver is tested."""

from __future__ import annotations

import re
from pathlib import Path
from xml.etree import ElementTree

import pytest

from msbot.config import BusKind, PartType, load_library
from msbot.hardware import read_parts
from tools import hardware_table

DRIVEN = [part_type for part_type in load_library() if part_type.driver.entry_point]


@pytest.fixture(scope="module")
def made() -> dict[Path, str]:
    """Pages and pictures as they should be."""
    return hardware_table.pages()


@pytest.mark.parametrize("path", [hardware_table.REFERENCE, hardware_table.WIRING], ids=lambda path: path.name)
def test_the_pages_are_up_to_date(path: Path, made: dict[Path, str]) -> None:
    assert path.read_text("utf-8") == made[path], "run `python tools/hardware_table.py`"


@pytest.mark.parametrize("part_type", DRIVEN, ids=lambda part_type: part_type.number)
def test_the_picture_shows_every_wire_and_is_up_to_date(part_type: PartType, made: dict[Path, str]) -> None:
    path = hardware_table.PICTURES / f"{part_type.number}.svg"
    text = path.read_text("utf-8")
    assert text == made[path], "run `python tools/hardware_table.py`"
    words = {element.text for element in ElementTree.fromstring(text).iter() if element.text}
    assert {pin.name for pin in part_type.pins} <= words
    for wire in part_type.driver.pins:
        assert wire.default is None or any(f" {wire.default} ({wire.name})" in word for word in words), wire
        assert not wire.description or wire.description in words, "a divider or resistor must not be overlooked"


def test_there_are_no_other_pictures() -> None:
    assert {path.stem for path in hardware_table.PICTURES.iterdir()} == {one.number for one in DRIVEN}


@pytest.mark.parametrize("part_type", DRIVEN, ids=lambda part_type: part_type.number)
def test_every_driver_is_named_in_a_test(part_type: PartType) -> None:
    assert hardware_table.tests_of(part_type)


def test_every_kind_of_bus_is_used() -> None:
    assert {part_type.driver.bus for part_type in DRIVEN} == set(BusKind)


def test_the_file_of_the_howto_is_right(tmp_path: Path) -> None:
    page = (hardware_table.ROOT / "docs/howto/raspberry_pi.md").read_text("utf-8")
    (text,) = re.findall(r"```toml\n(.*?)```", page, re.DOTALL)
    path = tmp_path / "parts.toml"
    path.write_text(text)
    assert [part.name for part in read_parts(path, load_library())] == ["front", "BMP280", "wheels", "head", "bumper"]
