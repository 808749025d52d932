"""`msbot library` as a user runs it."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from click.testing import CliRunner

from msbot.cli.library import command
from msbot_xrce.errors import ConfigError

LUX = (
    'number = "LUX-1"\nname = "Light sensor of room 12"\n'
    '[[port]]\nname = "lamp"\ndirection = "subscribe"\ntype = "Level"\n'
)


def said(*arguments: str | Path) -> str:
    """What a command prints that goes well."""
    result = CliRunner().invoke(command, [str(argument) for argument in arguments], catch_exceptions=False)
    assert result.exit_code == 0, result.output
    return result.output


def complaint(*arguments: str | Path) -> str:
    """What is said of a mistake."""
    with pytest.raises(ConfigError) as caught:
        said(*arguments)
    return str(caught.value)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "parts").mkdir()
    (tmp_path / "parts" / "lux.toml").write_text(LUX)
    return tmp_path / "parts"


def test_the_list_has_every_part_of_a_category(folder: Path) -> None:
    text = said("list", "--category", "display")
    assert "SSD1306  OLED display, 128 x 64 dots" in text
    assert "SG90" not in text
    everything = json.loads(said("list", "--json", "--library", folder))
    assert len(everything) > 40
    assert "LUX-1" in [entry["number"] for entry in everything]
    assert complaint("list", "--category", "motor").startswith("there is no category 'motor'; did you mean other?")


def test_a_search_prints_the_best_or_says_what_to_do(folder: Path) -> None:
    assert "HC-SR04" in said("search", "ultrasonic")
    assert "LUX-1" in said("search", "room", "12", "--library", folder)
    assert [entry["number"] for entry in json.loads(said("search", "gps", "--json"))] == ["NEO-6M"]
    assert said("search", "servo", "gps") == (
        "Nothing in the library has all of: servo gps. Try fewer words, or `msbot library list`.\n"
    )
    assert json.loads(said("search", "qqqq", "--json")) == []


def test_a_page_shows_ports_settings_pins_and_the_simulator() -> None:
    text = said("show", "HC-SR04")
    assert text.startswith("HC-SR04: Ultrasonic range sensor\nMeasures the distance")
    for line in (
        "supply         5 V, at most 15 mA",
        "fits slots for HC-SR04",
        "publishes  Distance",
        "offset_m  0.0 m    -1 to 1",
        "  2  TRIG  signal  10 us high",
        "obstacle  0.02 to 10 m       1.0",
        "in_range",
    ):
        assert line in text
    assert "fits slots for MG996R, MG90S, SG90" in said("show", "MG996R")
    assert "msbot.hardware.drivers.usb_gpio:UsbGpio8" in said("show", "NUMATO-8")
    assert "none, 1, 2, 3, A" in said("show", "KEYPAD-4X4")
    assert "true, false" in said("show", "BUTTON")


def test_a_page_as_json_has_the_same() -> None:
    found = json.loads(said("show", "SG90", "--json"))
    assert found["ports"] == [
        {
            "name": "angle",
            "direction": "subscribe",
            "type": "Angle",
            "fields": {"degrees": "float32"},
            "rate_hz": 0.0,
            "safe": {"degrees": 90.0},
            "ranges": {"degrees": [0.0, 180.0]},
            "description": "Where the arm is to go, 0 to 180 degrees",
        }
    ]
    assert found["supply"] == {"min_v": 4.8, "max_v": 6.0, "current_ma": 650.0}
    assert found["readings"] == [{"name": "arm", "unit": "deg", "words": "Angle of the arm"}]
    assert found["pins"][1] == {"name": "VCC", "kind": "power", "description": "red"}
    assert {entry["name"]: entry["max"] for entry in found["parameters"]}["trim"] == 30
    assert json.loads(said("show", "BUTTON", "--json"))["controls"][0]["momentary"] is True
    assert json.loads(said("show", "ABCD", "--json"))["supply"]["min_v"] == 5


def test_a_type_about_which_little_is_said_has_a_short_page(folder: Path) -> None:
    (folder / "lux.toml").write_text('number = "LUX-1"\nname = "lux"\n')
    assert "Ports" not in said("show", "LUX-1", "--library", folder)
    (folder / "lux.toml").write_text(LUX.replace("Level", "Text").replace("subscribe", "publish"))
    assert "lamp     any text" in said("show", "LUX-1", "--library", folder)


def test_a_picture_is_written(tmp_path: Path) -> None:
    said("show", "SG90", "--picture", tmp_path / "sg90.svg")
    assert (tmp_path / "sg90.svg").read_text().startswith("<svg")
    assert "cannot be written" in complaint("show", "SG90", "--picture", tmp_path / "no" / "sg90.svg")


def test_an_unknown_number_is_told_with_the_nearest() -> None:
    assert complaint("show", "SG9O") == 'the library has no part number "SG9O"; did you mean "SG90"?'


def test_what_is_right_is_said_with_hints(folder: Path) -> None:
    assert said("check").startswith("No mistake: 5")
    text = said("check", folder / "lux.toml")
    assert text.splitlines()[0] == (
        f'{folder}/lux.toml: hint: port "lamp" has no safe value: it keeps on when its master is lost; '
        "add safe = {...}"
    )
    assert f"1 of them from {folder}/lux.toml" in text
    (folder / "lux.toml").write_text(
        'number = "LUX-1"\nname = "lux"\n[driver]\nclass = "no_such_package:Lux"\nbus = "pins"\n'
    )
    text = said("check", folder)
    assert "the part has no port" in text
    assert "the driver no_such_package:Lux cannot be found on this computer" in text
    (folder / "lux.toml").write_text(
        'number = "LUX-1"\nname = "lux"\n[driver]\nclass = "no_such_package.lux:Lux"\nbus = "pins"\n'
    )
    assert "the driver no_such_package.lux:Lux cannot be found" in said("check", folder)
    (folder / "lux.toml").write_text(
        'number = "LUX-1"\nname = "lux"\n[driver]\nclass = "msbot.part:Lux"\nbus = "pins"\n'
    )
    assert "the driver msbot.part:Lux cannot be found" in said("check", folder)


def test_a_mistake_is_told_with_file_line_and_key(folder: Path) -> None:
    (folder / "lux.toml").write_text(LUX.replace('"Level"', '"Levle"'))
    assert complaint("check", folder) == (
        f'{folder}/lux.toml, line 6, port[0].type: there is no message type "Levle"; did you mean "Level"? '
        "Or declare it in a table [[type]]"
    )


def test_a_file_is_checked_and_copied(folder: Path, tmp_path: Path) -> None:
    text = said("add", folder / "lux.toml", "--to", tmp_path / "library")
    assert text == (
        f"{tmp_path}/library/lux.toml is written. Name its folder at the top of robot.toml:  "
        f'library = ["{tmp_path}/library"]\n'
    )
    assert (tmp_path / "library" / "lux.toml").read_text() == LUX
    again = complaint("add", folder / "lux.toml", "--to", tmp_path / "library")
    assert "exists already and is not overwritten" in again
    (folder / "other.toml").write_text(LUX)
    assert 'part number "LUX-1" is taken by' in complaint("add", folder / "other.toml", "--to", tmp_path / "library")
    assert "there is no such file" in complaint("add", folder / "none.toml", "--to", tmp_path / "library")


def test_a_new_number_gets_a_file_that_is_right_as_it_stands(tmp_path: Path) -> None:
    said("add", "LUX 2/b", "--to", tmp_path)
    path = tmp_path / "LUX_2_b.toml"
    assert 'number = "LUX 2/b"' in path.read_text()
    assert "No mistake" in said("check", tmp_path)
    # What stands there as a comment is right, too.
    path.write_text(
        "\n".join(line.removeprefix("# ") for line in path.read_text().splitlines()[1:] if "SG90" not in line)
    )
    (tmp_path / "LUX_2_b.toml").write_text(
        path.read_text()
        .replace("Ports: what", "# Ports: what")
        .replace("Parameters: what", "# Parameters: what")
        .replace("The simulator: what", "# The simulator: what")
    )
    assert "No mistake" in said("check", tmp_path)
    assert "is taken by" in complaint("add", "LUX 2/b", "--to", tmp_path)
    assert "cannot be a part number" in complaint("add", 'a"b', "--to", tmp_path)
    assert "cannot be a part number" in complaint("add", "..", "--to", tmp_path)
    (tmp_path / "lux.tml").touch()
    assert complaint("add", tmp_path / "lux.tml", "--to", tmp_path).endswith("such files end in .toml")
    assert "cannot be written" in complaint("add", "NEW", "--to", path / "folder")


@pytest.mark.parametrize(
    ("ends", "control", "setting"),
    [
        ("", "lx", "a number"),
        ("min = 0", "from 0 lx", "from 0"),
        ("max = 5", "up to 5 lx", "up to 5"),
        ("min = -1\nmax = 5.5", "-1 to 5.5 lx", "-1 to 5.5"),
    ],
)
def test_of_a_range_only_the_ends_that_it_has_are_said(ends: str, control: str, setting: str, folder: Path) -> None:
    (folder / "lux.toml").write_text(
        f'{LUX}[[parameter]]\nname = "limit"\ntype = "float"\ndefault = 1.0\n{ends}\n'
        f'[[simulator.control]]\nname = "light"\ntype = "number"\nstart = 1\nunit = "lx"\n{ends}\n'
    )
    page = said("show", "LUX-1", "--library", folder)
    rows = [[cell.strip() for cell in line.split("  ") if cell.strip()] for line in page.splitlines()]
    assert ["light", control, "1"] in [row[:3] for row in rows]
    assert ["limit", "1.0", setting] in [row[:3] for row in rows]
