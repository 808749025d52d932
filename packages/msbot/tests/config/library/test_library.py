"""Part types: the files MsBOT brings, files of one's own, and their mistakes."""

from pathlib import Path

import pytest

from msbot.config.library.part_library import (
    Direction,
    Library,
    Parameter,
    ParameterKind,
    PartType,
    load_library,
    scalar_text,
)
from msbot_agent.toml.table import Scalar
from msbot_xrce.errors import ConfigError

MOTOR = """\
number = "MOTOR-1"
name = "Motor"
compatible_with = ["WXYZ"]

[[port]]
name = "speed"
direction = "subscribe"
type = "Speed"
safe = { rpm = 0 }

[[port]]
name = "state"
direction = "publish"
type = "State"
rate_hz = 10

[[parameter]]
name = "ramp_s"
type = "float"
default = 1
min = 0
max = 10
unit = "s"
description = "Time from stop to full speed"

[[parameter]]
name = "invert"
type = "bool"
default = false

[[port]]
name = "out"
direction = "publish"
type = "HelloWorld"

[[port]]
name = "in"
direction = "subscribe"
type = "HelloWorld"

[[type]]
name = "Speed"
fields = { rpm = "float32" }

[[type]]
name = "State"
fields = { rpm = "float32", turns = "uint32" }
"""


def _folder(tmp_path: Path, **texts: str) -> Path:
    folder = tmp_path / "parts"
    folder.mkdir()
    for name, text in texts.items():
        (folder / f"{name}.toml").write_text(text)
    return folder


def _complaint(tmp_path: Path, text: str) -> str:
    folder = _folder(tmp_path, motor=text)
    with pytest.raises(ConfigError) as caught:
        load_library(folder)
    return str(caught.value).replace(str(folder), "parts")


def test_the_thesis_part_types_come_with_msbot() -> None:
    library = load_library()
    thesis = [part_type for part_type in library if part_type.number in ("ABCD", "EFGH", "WXYZ")]
    assert [part_type.specification for part_type in thesis] == ["5V", "5V", "5V"]
    assert [part_type.name for part_type in thesis] == ["Light sensor", "Toggle switch", "Motor driver"]
    light = library.get("ABCD")
    assert light is not None
    out = light.port("out")
    assert out is not None
    assert (out.direction, out.type_name, out.safe) == (Direction.PUBLISH, "HelloWorld", None)


def test_a_folder_of_ones_own_is_added(tmp_path: Path) -> None:
    library = load_library(_folder(tmp_path, motor=MOTOR))
    motor = library.get("MOTOR-1")
    assert motor is not None
    assert len(library) == len(load_library()) + 1
    assert motor.compatible_with == ("WXYZ",)
    assert motor.source.endswith("motor.toml")
    speed, state = motor.ports[:2]
    assert (speed.safe, speed.rate_hz, state.rate_hz) == ({"rpm": 0}, 0.0, 10.0)
    assert motor.parameter("ramp_s") == Parameter(
        "ramp_s", ParameterKind.FLOAT, 1, "s", 0.0, 10.0, "Time from stop to full speed"
    )
    assert motor.port("nothing") is None
    assert motor.parameter("nothing") is None


def test_the_nearest_numbers_are_known() -> None:
    library = Library([PartType("ABCD", "x"), PartType("EFGH", "y")])
    assert library.nearest("abce") == ["ABCD"]
    assert library.get("abcd") is None


@pytest.mark.parametrize(
    ("number", "right"),
    [
        ("sg9O", 'did you mean "SG90"?'),
        ("servo", 'did you mean "MG90S" (Servo with metal gear, 180 degrees) or '),
        ("ultrasonic", 'did you mean "HC-SR04" (Ultrasonic range sensor)?'),
        ("qqqqqq", "`msbot library list` shows what there is"),
    ],
)
def test_a_number_that_is_not_there_is_answered_with_what_may_be_meant(number: str, right: str) -> None:
    assert load_library().suggest(number).startswith(right)
    assert Library([PartType("A", "a"), PartType("B", "b")]).suggest("qqqqqq") == 'known: "A", "B"'
    assert Library().suggest("A") == "the library is empty"


def test_a_missing_folder_is_told(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="nowhere: there is no such library folder; create it or name another one"):
        load_library(tmp_path / "nowhere")


def test_two_types_of_one_number(tmp_path: Path) -> None:
    sentence = _complaint(tmp_path, 'name = "Sensor"\nnumber = "ABCD"')
    assert sentence == (
        'parts/motor.toml, line 2, number: part number "ABCD" is taken by msbot library, ABCD.toml; '
        "give each type a number of its own"
    )


def test_mistakes_of_several_files_are_told_at_once(tmp_path: Path) -> None:
    folder = _folder(tmp_path, a="number = 1", b="[[port", c=MOTOR)
    with pytest.raises(ConfigError) as caught:
        load_library(folder, tmp_path / "nowhere")
    text = str(caught.value)
    assert text.startswith("4 problems were found:")
    assert 'a.toml, line 1, number: must be text in quotes, for example number = "ABCD"; it is the number 1' in text
    assert 'a.toml, name: is missing; add a line such as name = "Light sensor"' in text
    assert "b.toml, line 1: at the end of the file: a bracket ] is missing behind the table's name" in text


WRONG = [
    (
        '"subscribe"',
        '"subscibe"',
        'line 7, port[0].direction: "subscibe" is none of "publish", "subscribe", "serve", "call"; did you mean',
    ),
    ('name = "speed"', "", 'line 5, port[0].name: is missing; add a line such as name = "light"'),
    ('"speed"', '"a.b"', 'line 6, port[0].name: "a.b" must not contain "."'),
    ('"state"', '"speed"', 'line 12, port[1].name: there are two with the name "speed"; give each its own'),
    ('"invert"', '"ramp_s"', 'line 27, parameter[1].name: there are two with the name "ramp_s"; give each its own'),
    ("rate_hz = 10", "rate_hz = -1", "line 15, port[1].rate_hz: is -1; it must be 0 to 10000 times a second"),
    ("rate_hz = 10", "safe = {a = 1}", "line 15, port[1].safe: only a port that subscribes can have a safe value"),
    ("safe = { rpm = 0 }", "save = 1", 'line 9, port[0].save: there is no such key here; did you mean "safe"?'),
    ("default = 1", "", "line 17, parameter[0].default: is missing; add the value that holds when nobody sets another"),
    (
        "default = 1",
        "default = []",
        "line 20, parameter[0].default: must be a number, true, false or a text; it is a list",
    ),
    ("default = 1", "default = 11", "line 20, parameter[0].default: is 11; it must be 0 to 10 s"),
    ("default = false", "default = 1", "line 29, parameter[1].default: must be true or false"),
    ("default = false", "default = false\nmin = 1", "line 30, parameter[1].min: only a parameter of type int or float"),
    ('"float"', '"flaot"', 'line 19, parameter[0].type: "flaot" is none of "bool", "int", "float", "text"'),
    ('unit = "s"', "unti = 1", 'line 23, parameter[0].unti: there is no such key here; did you mean "unit"?'),
    ('name = "Motor"', 'name = "Motor"\nnane = 1', 'line 3, nane: there is no such key here; did you mean "name"?'),
]


@pytest.mark.parametrize(("right", "wrong", "sentence"), WRONG)
def test_a_mistake_names_file_line_and_key(tmp_path: Path, right: str, wrong: str, sentence: str) -> None:
    assert f"parts/motor.toml, {sentence}" in _complaint(tmp_path, MOTOR.replace(right, wrong, 1))


SERVER = """number = "CAM-1"
name = "Camera"
[[port]]
name = "photo"
direction = "server"
request = "Angle"
reply = "Text"
"""


def test_a_wrong_direction_is_one_mistake(tmp_path: Path) -> None:
    words = (
        'line 5, port[0].direction: "server" is none of "publish", "subscribe", "serve", "call"; did you mean "serve"?'
    )
    found = _complaint(tmp_path, SERVER)
    assert words in found
    assert found.count("port[0]") == 1


def test_a_wrong_direction_of_a_topic_is_one_mistake(tmp_path: Path) -> None:
    assert _complaint(tmp_path, MOTOR.replace('"subscribe"', '"subscibe"', 1)).count("port[0]") == 1


RANGE = Parameter("n", ParameterKind.INT, 5, "mm", least=1, most=9)

FAULTS: list[tuple[Parameter, Scalar, str | None]] = [
    (RANGE, 9, None),
    (RANGE, 10, "is 10; it must be 1 to 9 mm"),
    (RANGE, 1.5, "must be a whole number, for example '5'; it is the number 1.5"),
    (RANGE, True, "must be a whole number, for example '5'; it is the truth value true"),
    (Parameter("x", ParameterKind.FLOAT, 0.5, least=0), 1e9, None),
    (Parameter("x", ParameterKind.FLOAT, 0.5, least=0), -1, "is -1; it must be at least 0"),
    (Parameter("x", ParameterKind.FLOAT, 0.5, most=2), 3.5, "is 3.5; it must be at most 2"),
    (Parameter("x", ParameterKind.FLOAT, 0.5, most=2), float("nan"), "is nan; it must be at most 2"),
    (Parameter("x", ParameterKind.TEXT, "a"), "b", None),
    (Parameter("x", ParameterKind.TEXT, "a"), 1, "must be text in quotes, for example 'a'; it is the number 1"),
    (
        Parameter("x", ParameterKind.BOOL, False),
        "no",
        "must be true or false, for example 'false'; it is the text \"no\"",
    ),
]


@pytest.mark.parametrize(("parameter", "value", "fault"), FAULTS)
def test_a_parameter_says_which_values_it_takes(parameter: Parameter, value: Scalar, fault: str | None) -> None:
    assert parameter.fault(value) == fault


PARSED: list[tuple[ParameterKind, str, Scalar | None]] = [
    (ParameterKind.BOOL, "true", True),
    (ParameterKind.BOOL, "yes", None),
    (ParameterKind.INT, "12", 12),
    (ParameterKind.INT, "1.5", None),
    (ParameterKind.FLOAT, "1.5", 1.5),
    (ParameterKind.FLOAT, "much", None),
    (ParameterKind.TEXT, "much", "much"),
]


@pytest.mark.parametrize(("kind", "text", "value"), PARSED)
def test_a_text_stands_for_a_value_of_its_kind_or_for_none(
    kind: ParameterKind, text: str, value: Scalar | None
) -> None:
    assert kind.parse(text) == value


@pytest.mark.parametrize(("value", "text"), [(True, "true"), (False, "false"), (1, "1"), (0.5, "0.5"), ("Ab", "Ab")])
def test_a_value_as_text(value: Scalar, text: str) -> None:
    assert scalar_text(value) == text
