"""What else a library file says: supply, pins, driver, picture, versions, safe values; and the pages about it."""

import re
import textwrap
from pathlib import Path

import pytest

from msbot.config import Category, PartType, Pin, PinKind, Supply, load_library, open_blueprint
from msbot.errors import ConfigError

TEXT = """\
number = "X"
name = "x"
category = "actuator"
keywords = ["lamp", "torch"]
versions = ">=1, <3"
connector = "2 pins"
driver = "msbot.part:SimGpio"
picture = "<svg/>"
[supply]
min_v = 3
max_v = 5
current_ma = 20
[[pin]]
name = "VCC"
kind = "power"
[[pin]]
name = "S"
description = "high = on"
[[port]]
name = "on"
direction = "subscribe"
type = "Switch"
safe = { on = false }
description = "Whether it shines"
"""
PAGE = (Path(__file__).parents[3] / "docs/howto/add_a_part_type.md").read_text()


def load(folder: Path, text: str) -> PartType:
    (folder / "x.toml").write_text(text)
    part_type = load_library(folder / "x.toml").get("X")
    assert part_type is not None
    return part_type


def test_everything_is_read(tmp_path: Path) -> None:
    found = load(tmp_path, TEXT)
    assert found.category is Category.ACTUATOR
    assert found.keywords == ("lamp", "torch")
    assert "2.9" in found.versions
    assert "3" not in found.versions
    assert (found.connector, found.driver, found.picture) == ("2 pins", "msbot.part:SimGpio", "<svg/>")
    assert found.supply == Supply(3, 5, 20)
    assert str(found.supply) == "3 to 5 V, at most 20 mA"
    assert str(Supply(5, 5)) == "5 V"
    assert found.pins == (Pin("VCC", PinKind.POWER), Pin("S", PinKind.SIGNAL, "high = on"))
    assert found.ports[0].safe == {"on": False}
    assert found.ports[0].description == "Whether it shines"


WRONG = [
    ('number = "X"', 'number = "X@1"', 'line 1, number: "X@1" must not contain "@"'),
    ('"actuator"', '"motor"', 'line 3, category: "motor" is none of "sensor"'),
    ('">=1, <3"', '"1 to 3"', 'line 5, versions: "1 to 3" is no range of versions; write for example'),
    ('"msbot.part:SimGpio"', '"SimGpio"', 'line 7, driver: "SimGpio" is no entry point; write package.module:Name'),
    ('"<svg/>"', '"lamp.png"', "line 8, picture: is no SVG (syntax error: line 1, column 0)"),
    ('"<svg/>"', "5", "line 8, picture: must be an SVG text; it is the number 5"),
    ("min_v = 3", "min_v = 6", "line 10, supply.min_v: is 6, more than max_v = 5; exchange the two"),
    ("min_v = 3", "min_v = -1", "line 10, supply.min_v: is -1; it must be 0 to 1000 V"),
    ("min_v = 3", "minv = 3", 'line 10, supply.minv: there is no such key here; did you mean "min_v"?'),
    ('kind = "power"', 'kind = "5V"', 'line 15, pin[0].kind: "5V" is none of "power"'),
    ("{ on = false }", "{ no = false }", 'port[0].safe.no: a Switch has no field "no"; known: "on"'),
    ("{ on = false }", "{ on = 0 }", "port[0].safe.on: must be true or false; it is the number 0"),
]


@pytest.mark.parametrize(("right", "wrong", "sentence"), WRONG)
def test_a_mistake_is_told_with_line_and_key(tmp_path: Path, right: str, wrong: str, sentence: str) -> None:
    with pytest.raises(ConfigError) as caught:
        load(tmp_path, TEXT.replace(right, wrong, 1))
    assert sentence in str(caught.value)


def test_the_page_shows_a_file_that_is_right(tmp_path: Path) -> None:
    blocks = [textwrap.dedent(block) for block in re.findall(r"```toml\n(.*?)```", PAGE, re.DOTALL)]
    part, output, blueprint, message = blocks
    (tmp_path / "lux-1.toml").write_text(part + output + message)
    library = load_library(tmp_path)
    lux = library.get("LUX-1")
    assert lux is not None
    assert lux.simulator is not None
    assert lux.simulator.outputs[0].fields == {"lux": "brightness"}
    assert "Wind" in library.messages
    (tmp_path / "parts").mkdir()
    (tmp_path / "lux-1.toml").rename(tmp_path / "parts/lux-1.toml")
    (tmp_path / "robot.toml").write_text(blueprint)
    robot, _ = open_blueprint(tmp_path / "robot.toml")
    assert [slot.part_number for slot in robot.slots] == ["LUX-1"]


def test_the_page_of_the_library_shows_what_is_said(tmp_path: Path) -> None:
    page = (Path(__file__).parents[3] / "docs/reference/library.md").read_text()
    text = (
        'number = "LUX"\nname = "lux"\n\n[[port]]\nname = "light"\ndirection = "publish"\ntype = "Lihgt"\n'
        '[[simulator.control]]\nname = "brightness"\ntype = "number"\nstart = 1\n'
        '[[simulator.reading]]\nname = "seen"\nfollows = "brigthness"\n'
    )
    (tmp_path / "lux.toml").write_text(text)
    with pytest.raises(ConfigError) as caught:
        load_library(tmp_path)
    assert str(caught.value).replace(str(tmp_path), "parts") in page
