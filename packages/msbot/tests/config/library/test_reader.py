"""What else a library file says: supply, pins, driver, picture, versions, safe values; and the pages about it."""

import re
import textwrap
from pathlib import Path

import pytest

from msbot.config import (
    BusKind,
    Category,
    DriverPin,
    DriverSpec,
    Parameter,
    ParameterKind,
    PartType,
    Pin,
    PinKind,
    Supply,
    load_library,
    open_blueprint,
)
from msbot_xrce.errors import ConfigError
from tests import ROOT

TEXT = """\
number = "X"
name = "x"
category = "actuator"
keywords = ["lamp", "torch"]
versions = ">=1, <3"
connector = "2 pins"
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
[driver]
class = "my_parts:Lamp"
bus = "i2c"
addresses = [0x20, 0x21]
device = "/dev/x"
[[driver.pin]]
name = "s"
pin = "S"
gpio = 17
description = "with a resistor"
[[driver.pin]]
name = "level"
pin = "S"
channel = 2
[[driver.option]]
name = "full_v"
type = "float"
default = 3.3
min = 1
"""
PAGE = (ROOT / "docs/howto/add_a_part_type.md").read_text()


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
    assert (found.connector, found.picture) == ("2 pins", "<svg/>")
    assert found.driver == DriverSpec(
        "my_parts:Lamp",
        BusKind.I2C,
        (DriverPin("s", "S", 17, description="with a resistor"), DriverPin("level", "S", 2, analog=True)),
        (0x20, 0x21),
        "/dev/x",
        (Parameter("full_v", ParameterKind.FLOAT, 3.3, least=1),),
    )
    assert found.supply == Supply(3, 5, 20)
    assert str(found.supply) == "3 to 5 V, at most 20 mA"
    assert str(Supply(5, 5)) == "5 V"
    assert found.pins == (Pin("VCC", PinKind.POWER), Pin("S", PinKind.SIGNAL, "high = on"))
    assert found.ports[0].safe == {"on": False}
    assert found.ports[0].description == "Whether it shines"


WRONG = [
    ('number = "X"', 'number = "X@1"', 'line 1, number: "X@1" must not contain "@"'),
    ('"actuator"', '"motor"', 'line 3, category: "motor" is none of "sensor"'),
    ('">=1, <3"', '"1 to 3"', 'line 5, versions: "1 to 3" is not a range of versions; write for example'),
    ('"my_parts:Lamp"', '"Lamp"', 'line 25, driver.class: "Lamp" is not an entry point; write package.module:Name'),
    ('"i2c"', '"iic"', 'driver.bus: "iic" is none of "pins"'),
    ("[0x20, 0x21]", "[0x20, 0x80]", "driver.addresses[1]: is 128; it must be 8 to 119"),
    ("[0x20, 0x21]", '["0x20"]', 'driver.addresses[0]: must be a whole number; it is the text "0x20"'),
    ("[0x20, 0x21]", "0x20", "driver.addresses: must be a list, for example addresses = [8]; it is the number 32"),
    ("addresses = [0x20, 0x21]\n", "", "driver.addresses: is missing; name what the chip can have"),
    ('pin = "S"', 'pin = "T"', 'driver.pin[0].pin: the part has no pin "T"; known: "VCC", "S"'),
    ('name = "level"', 'name = "s"', 'driver.pin[1].name: there are two with the name "s"'),
    ("gpio = 17", "gpio = 300", "driver.pin[0].gpio: is 300; it must be 0 to 255"),
    ('"<svg/>"', '"lamp.png"', "line 7, picture: is no SVG (syntax error: line 1, column 0)"),
    ('"<svg/>"', "5", "line 7, picture: must be an SVG text; it is the number 5"),
    ("min_v = 3", "min_v = 6", "line 9, supply.min_v: is 6, more than max_v = 5; exchange the two"),
    ("min_v = 3", "min_v = -1", "line 9, supply.min_v: is -1; it must be 0 to 1000 V"),
    ("min_v = 3", "minv = 3", 'line 9, supply.minv: there is no such key here; did you mean "min_v"?'),
    ('kind = "power"', 'kind = "5V"', 'line 14, pin[0].kind: "5V" is none of "power"'),
    ("{ on = false }", "{ no = false }", 'port[0].safe.no: a Switch has no field "no"; known: "on"'),
    ("{ on = false }", "{ on = 0 }", "port[0].safe.on: must be true or false; it is the number 0"),
    ("safe = { on = false }", "ranges = { no = [0, 1] }", 'port[0].ranges.no: a Switch has no field "no"; known: "on"'),
    ("safe = { on = false }", "ranges = { on = [0, 1] }", "port[0].ranges.on: only a number has a range; remove it"),
    *(
        (
            'type = "Switch"\nsafe = { on = false }',
            f'type = "Level"\nranges = {{ percent = {value} }}',
            "port[0].ranges.percent: must be the least and the greatest value, for example percent = [0, 100]",
        )
        for value in ("100", "[0]", "[100, 0]", '["0", "1"]', "[false, true]", "[nan, 1]")
    ),
    (
        'type = "Switch"\nsafe = { on = false }',
        'type = "Level"\nsafe = { percent = 5 }\nranges = { percent = [10, 100] }',
        "port[0].safe.percent: must be from 10 to 100 %; it is 5",
    ),
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
    page = (ROOT / "docs/reference/library.md").read_text()
    text = (
        'number = "LUX"\nname = "lux"\n\n[[port]]\nname = "light"\ndirection = "publish"\ntype = "Lihgt"\n'
        '[[simulator.control]]\nname = "brightness"\ntype = "number"\nstart = 1\n'
        '[[simulator.reading]]\nname = "seen"\nfollows = "brigthness"\n'
    )
    (tmp_path / "lux.toml").write_text(text)
    with pytest.raises(ConfigError) as caught:
        load_library(tmp_path)
    assert str(caught.value).replace(str(tmp_path), "parts") in page


def test_a_type_may_say_why_it_has_no_driver(tmp_path: Path) -> None:
    text = TEXT[: TEXT.index("[driver]")]
    assert load(tmp_path, text).driver == DriverSpec()
    assert load(tmp_path, text + '[driver]\nnone = "too wild"\n').driver == DriverSpec(none="too wild")
