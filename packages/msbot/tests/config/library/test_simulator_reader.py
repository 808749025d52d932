"""The `[simulator]` table: its mistakes, and what is made up when it says nothing."""

from pathlib import Path

import pytest

from msbot.config import ControlKind, Output, PartType, Reading, Simulator, load_library
from msbot_xrce.errors import ConfigError

HEAD = """\
number = "X"
name = "x"
[[parameter]]
name = "gain"
type = "float"
default = 2.0
[[parameter]]
name = "flip"
type = "bool"
default = false
[[port]]
name = "light"
direction = "publish"
type = "Light"
rate_hz = 4
[[port]]
name = "say"
direction = "subscribe"
type = "HelloWorld"
[[port]]
name = "stick"
direction = "publish"
type = "Stick"
"""
SIMULATOR = """
[[simulator.control]]
name = "lamp"
type = "number"
start = 5
min = 0
max = 9
unit = "lx"
words = "Turn the lamp"
[[simulator.control]]
name = "mode"
type = "choice"
choices = ["a", "b"]
[[simulator.reading]]
name = "seen"
follows = "lamp"
scale = "gain"
negate = "flip"
noise = 0.1
[[simulator.reading]]
name = "heard"
follows = "say.message"
pattern = 'n=(\\d)'
[[simulator.publish]]
port = "light"
fields = { lux = "seen" }
"""


def load(folder: Path, text: str) -> PartType:
    (folder / "x.toml").write_text(text)
    part_type = load_library(folder).get("X")
    assert part_type is not None
    return part_type


def simulator(folder: Path, text: str) -> Simulator:
    found = load(folder, text).simulator
    assert found is not None
    return found


def test_everything_is_read(tmp_path: Path) -> None:
    found = simulator(tmp_path, HEAD + SIMULATOR)
    lamp, mode = found.controls[:2]
    assert (lamp.kind, lamp.start, lamp.least, lamp.most, lamp.unit, lamp.words) == (
        ControlKind.NUMBER,
        5,
        0,
        9,
        "lx",
        "Turn the lamp",
    )
    assert (mode.start, mode.choices) == ("a", ("a", "b"))
    assert found.readings == (
        Reading("seen", follows="lamp", scale="gain", negate="flip", noise=0.1),
        Reading("heard", follows="say.message", pattern=r"n=(\d)"),
    )
    assert found.outputs[0] == Output("light", {"lux": "seen"}, every=0.25)


def test_ports_about_which_nothing_is_said_get_controls_and_readings(tmp_path: Path) -> None:
    found = simulator(tmp_path, HEAD)
    assert [(control.name, control.kind) for control in found.controls] == [
        ("light", ControlKind.NUMBER),
        ("stick_x", ControlKind.NUMBER),
        ("stick_y", ControlKind.NUMBER),
        ("stick_pressed", ControlKind.BOOL),
    ]
    assert [(reading.name, reading.follows) for reading in found.readings] == [
        ("say_index", "say.index"),
        ("say_message", "say.message"),
    ]
    assert found.outputs == (
        Output("light", {"lux": "light"}, every=0.25),
        Output("stick", {"x": "stick_x", "y": "stick_y", "pressed": "stick_pressed"}, on_change=True),
    )


def test_a_field_takes_the_source_of_its_name_or_of_its_port(tmp_path: Path) -> None:
    table = '[[simulator.control]]\nname = "lux"\ntype = "number"\nstart = 1\n[[simulator.publish]]\nport = "light"\n'
    assert simulator(tmp_path, HEAD + table).outputs[0] == Output("light", {"lux": "lux"}, every=0.25)
    assert simulator(tmp_path, HEAD + table.replace("lux", "light")).outputs[0].fields == {"lux": "light"}


WRONG = [
    ("start = 5", "", "simulator.control[0].start: is missing; add the value before anybody does something"),
    ("start = 5", "start = 10", "simulator.control[0].start: is 10; it must be 0 to 9 lx"),
    ("start = 5", 'start = "x"', "simulator.control[0].start: must be a number, 0 to 9 lx"),
    ('name = "lamp"', 'name = "gain"', '"gain" is the name of something else already; choose another'),
    ('name = "lamp"', 'name = "a.b"', 'simulator.control[0].name: "a.b" must not contain "."'),
    ('choices = ["a", "b"]', "", "simulator.control[1].choices: is missing"),
    ("min = 0", 'choices = ["a"]', 'only a control of type "choice" has choices; remove it'),
    ('choices = ["a", "b"]', 'choices = ["a"]\nmin = 1', 'only a control of type "number" has limits; remove it'),
    (
        'follows = "lamp"',
        'follows = "lmap"',
        'simulator.reading[0].follows: "lmap" is not a parameter, control, reading',
    ),
    ('follows = "lamp"', 'follows = "heard"', '"heard" is not a parameter'),  # it stands further down
    ('follows = "say.message"', 'follows = "say.mesage"', 'did you mean "say.message"'),
    ('scale = "gain"', "scale = true", "simulator.reading[0].scale: must be a number or the name of a source"),
    ('scale = "gain"', 'scale = "gian"', 'simulator.reading[0].scale: "gian" is not a parameter'),
    ('follows = "lamp"', "", "simulator.reading[0]: needs exactly one of follows, text and random_every"),
    ('follows = "lamp"', 'follows = "lamp"\ntext = "{lamp}"', "needs exactly one of follows, text and random_every"),
    ('follows = "lamp"', "random_every = 1", "a reading that is drawn needs min and max"),
    ('follows = "lamp"', 'text = "{lmap}"', 'simulator.reading[0].text: "lmap" is not a parameter'),
    ('follows = "lamp"', 'text = "{lamp:zz}"', 'simulator.reading[0].text: "zz" is not a format for the number 5'),
    (r"'n=(\d)'", r"'n=(\d'", "simulator.reading[1].pattern: is not a regular expression"),
    (r"'n=(\d)'", r"'n=\d'", "simulator.reading[1].pattern: must have one group in ()"),
    ("noise = 0.1", "nosie = 0.1", 'there is no such key here; did you mean "noise"?'),
    ("noise = 0.1", 'function = "tan"', '"tan" is none of "none", "sin", "cos"'),
    ('port = "light"', 'port = "say"', 'simulator.publish[0].port: there is no port "say" that publishes'),
    ('port = "light"', 'port = "ligth"', 'there is no port "ligth" that publishes; did you mean "light"?'),
    ('{ lux = "seen" }', '{ lx = "seen" }', 'a Light has no field "lx"; did you mean "lux"?'),
    ('{ lux = "seen" }', '{ lux = "sene" }', 'simulator.publish[0].fields.lux: "sene" is not a parameter'),
    ('{ lux = "seen" }', "{ lux = true }", "must be a number; it is the truth value true"),
    ('{ lux = "seen" }', "{}", 'says nothing of the field "lux"; add lux = and the name of a control or reading'),
    ('{ lux = "seen" }', '{ lux = "seen" }\nonly_if = "x"', 'simulator.publish[0].only_if: "x" is not a parameter'),
    ("[[simulator.publish]]", "[simulator.publish]", "must begin with two brackets, [[publish]]"),
]


@pytest.mark.parametrize(("right", "wrong", "sentence"), WRONG)
def test_a_mistake_is_told_with_its_key(tmp_path: Path, right: str, wrong: str, sentence: str) -> None:
    assert right in SIMULATOR
    with pytest.raises(ConfigError) as caught:
        load(tmp_path, HEAD + SIMULATOR.replace(right, wrong, 1))
    assert sentence in str(caught.value)


SCANNER = """
number = "X"
name = "Scanner"
[[port]]
name = "scan"
direction = "publish"
type = "Scan"
[[port]]
name = "lamps"
direction = "publish"
type = "Strip"
[[simulator.control]]
name = "near"
type = "number"
start = 1.5
[[simulator.publish]]
port = "scan"
fields = { angle_min = 0, angle_step = 1, reach = 4, metres = ["near", 2.5] }
[[simulator.publish]]
port = "lamps"
fields = { colours = [["near", 0, 255]] }
"""


def test_a_list_is_made_of_sources_and_values(tmp_path: Path) -> None:
    outputs = simulator(tmp_path, SCANNER).outputs
    assert outputs[0].fields["metres"] == ("near", 2.5)
    assert outputs[1].fields["colours"] == (("near", 0, 255),)
    assert list(outputs[1].scalars()) == ["near", 0, 255]


@pytest.mark.parametrize(
    ("right", "wrong", "sentence"),
    [
        ('["near", 2.5]', '["neer", 2.5]', '"neer" is not a parameter, control, reading above or field of a port'),
        ('["near", 2.5]', "[true]", "each element is the name of a source or a value, which must be a number"),
        (
            '["near", 0, 255]',
            '["near", 0]',
            "each element is the name of a source or a value, which must have the fields",
        ),
        ('["near", 0, 255]', '["near", 0, 256]', "which must be a whole number from 0 to 255"),
        ('["near", 2.5]', str([1] * 361), "must have at most 360 elements; it has 361"),
    ],
)
def test_a_mistake_in_a_list_is_told(tmp_path: Path, right: str, wrong: str, sentence: str) -> None:
    assert right in SCANNER
    with pytest.raises(ConfigError) as caught:
        load(tmp_path, SCANNER.replace(right, wrong, 1))
    assert sentence in str(caught.value)
