"""What must agree in a blueprint: slots, settings, bindings and periods."""

from pathlib import Path

import pytest

from msbot.config.blueprint.blueprint_file_reader import load_blueprint
from msbot.config.blueprint.check import RESERVED_TOPICS
from msbot.config.library.part_library import Direction, Library, Parameter, ParameterKind, PartType, Port, load_library
from msbot_xrce.errors import ConfigError

LIBRARY = Library(
    [
        PartType(
            "EYE",
            "Light sensor",
            ports=(Port("light", Direction.PUBLISH, "Light"), Port("raw", Direction.PUBLISH, "Raw")),
            parameters=(Parameter("period_s", ParameterKind.FLOAT, 0.5, "s", 0.01, 60),),
        ),
        PartType(
            "LEG",
            "Motor driver",
            ports=(
                Port("goal", Direction.SUBSCRIBE, "Light"),
                Port("other", Direction.SUBSCRIBE, "Raw"),
                Port("state", Direction.PUBLISH, "Raw"),
            ),
        ),
    ]
)

ROBOT = """\
[robot]
name = "R"
version = "1"
serial_number = "1"
released = "x"
manufacturer = "y"
[timing]
[options]
[[slot]]
name = "eye"
part = "EYE"
[slot.settings]
period_s = 1
[[slot]]
name = "leg"
part = "LEG"
[[binding]]
topic = "brightness"
type = "Light"
from = "eye.light"
to = ["leg.goal"]
[[binding]]
topic = "speed"
type = "Raw"
from = "leg.state"
to = []
"""


def _load(tmp_path: Path, text: str, library: Library = LIBRARY) -> list[str]:
    path = tmp_path / "robot.toml"
    path.write_text(text)
    try:
        load_blueprint(path, library)
    except ConfigError as error:
        lines = str(error).replace(f"{tmp_path}/", "").splitlines()
        return lines if len(lines) == 1 else [line.strip() for line in lines[1:]]
    return []


def test_a_robot_in_which_all_agrees_has_no_problem(tmp_path: Path) -> None:
    assert _load(tmp_path, ROBOT) == []


SLOTS = [
    (
        'name = "leg"',
        'name = "eye"',
        'line 15, slot[1].name: there is a slot "eye" already on line 10; give each slot a',
    ),
    ('"EYE"', '"EYES"', 'line 11, slot[0].part: the library has no part number "EYES"; did you mean "EYE"?'),
    ('"EYE"', '"?"', 'line 11, slot[0].part: the library has no part number "?"; known: "EYE", "LEG"'),
    (
        "period_s = 1",
        "perid_s = 1",
        'line 13, slot[0].settings.perid_s: part EYE has no parameter "perid_s"; did you mean "period_s"?',
    ),
    (
        "period_s = 1",
        "period_s = 99",
        "line 13, slot[0].settings.period_s: is 99; it must be 0.01 to 60 s; the library's default is period_s = 0.5",
    ),
    (
        "period_s = 1",
        'period_s = "1"',
        "line 13, slot[0].settings.period_s: must be a number, for example '0.5'; it is the text \"1\"",
    ),
    (
        'part = "LEG"',
        'part = "LEG"\nsettings = {x = 1}',
        'line 17, slot[1].settings.x: part LEG has no parameter "x"; it has none: remove the line',
    ),
]


@pytest.mark.parametrize(("right", "wrong", "sentence"), SLOTS)
def test_slots_agree_with_each_other_and_the_library(tmp_path: Path, right: str, wrong: str, sentence: str) -> None:
    found = _load(tmp_path, ROBOT.replace(right, wrong, 1))
    assert any(line.startswith(f"robot.toml, {sentence}") for line in found), found


def test_an_empty_library_is_told(tmp_path: Path) -> None:
    found = _load(tmp_path, ROBOT, Library())
    assert 'robot.toml, line 11, slot[0].part: the library has no part number "EYE"; the library is empty' in found


BINDINGS = [
    (
        '"eye.light"',
        '"eye"',
        'line 20, binding[0].from: "eye" names no port; write slot, dot, port, for example "eye.light"',
    ),
    (
        '"eye.light"',
        '"ey"',
        'line 20, binding[0].from: "ey" names no port; write slot, dot, port, for example "AA.out"',
    ),
    (
        '"leg.goal"',
        '"leg."',
        'line 21, binding[0].to[0]: "leg" names no port; write slot, dot, port, for example "leg.goal"',
    ),
    (
        '"eye.light"',
        '"eyee.light"',
        'line 20, binding[0].from: "eyee.light": there is no slot "eyee"; did you mean "eye"?',
    ),
    (
        '"eye.light"',
        '"eye.ligth"',
        'line 20, binding[0].from: "eye.ligth": part EYE (Light sensor) has no port "ligth"; did you mean "light"?',
    ),
    (
        '"leg.goal"',
        '"eye.goal"',
        'line 21, binding[0].to[0]: "eye.goal": part EYE (Light sensor) has no port "goal"; '
        "it has none that can subscribe",
    ),
    (
        '"eye.light"',
        '"leg.goal"',
        'line 20, binding[0].from: "leg.goal": this port can only subscribe; use "state"',
    ),
    (
        '"leg.goal"',
        '"leg.state"',
        'line 21, binding[0].to[0]: "leg.state": this port can only publish; use "goal" or "other"',
    ),
    (
        '"leg.goal"',
        '"eye.light"',
        'line 21, binding[0].to[0]: "eye.light": this port can only publish; '
        "part EYE has no port that can subscribe: choose another slot",
    ),
    (
        '"leg.goal"',
        '"leg.other"',
        'line 21, binding[0].to[0]: "leg.other" carries messages of type "Raw", the binding says "Light"; '
        'write type = "Raw" or bind another port',
    ),
    ('["leg.goal"]', '["leg.goal",\n"leg.goal"]', 'line 22, binding[0].to[1]: "leg.goal" is there twice; keep one'),
    (
        '"brightness"',
        '"msbot_masterTopic"',
        'line 18, binding[0].topic: "msbot_masterTopic" belongs to plug-and-play itself; choose another name',
    ),
    (
        '"speed"',
        '"brightness"',
        'line 24, binding[1].type: topic "brightness" carries "Light" in another binding and "Raw" here; '
        "a topic has one type",
    ),
]


@pytest.mark.parametrize(("right", "wrong", "sentence"), BINDINGS)
def test_bindings_join_ports_that_fit(tmp_path: Path, right: str, wrong: str, sentence: str) -> None:
    assert _load(tmp_path, ROBOT.replace(right, wrong, 1)) == [f"robot.toml, {sentence}"]


BOARD = """\
[[slot]]
name = "board"
part = "BOARD-8"
[slot.settings]
part_1 = "HC-SR04 eye: trigger=5, echo=18"
part_2 = "BMP280 air: scl=22, sda=21"
part_3 = "BH1750 light: scl=22, sda=21"
"""


@pytest.mark.parametrize(
    ("right", "wrong", "sentence"),
    [
        ("echo=18", "echo=18", None),
        ("echo=18", "ecco=18", 'line 7, slot[0].settings.part_1: part HC-SR04 has no wire or option "ecco"'),
        ("echo=18", "echo=22", "line 8, slot[0].settings.part_2: pin 22 is taken by part_1; wire one"),
        (
            "BH1750",
            "BH1750 air:",
            "line 9, slot[0].settings.part_3: 'BH1750 air: light: scl=22, sda=21': 'light:' needs",
        ),
        ("BH1750 light", "BH1750 air", "line 9, slot[0].settings.part_3: part_2 is called 'air', too; give each part"),
        ("BH1750", "BMP280", "line 9, slot[0].settings.part_3: address 0x76 of the I2C at pin 21 is taken by part_2"),
        ("sda=21", "sda=22", "line 8, slot[0].settings.part_2: two wires are at one pin; give each its own"),
    ],
)
def test_what_is_wired_to_a_board_is_checked(tmp_path: Path, right: str, wrong: str, sentence: str | None) -> None:
    text = '[robot]\nname = "R"\n' + BOARD.replace(right, wrong, 1)
    found = _load(tmp_path, text, load_library())
    assert found == [] if sentence is None else len(found) == 1 and f"robot.toml, {sentence}" in found[0], found


def test_one_port_is_bound_to_a_topic_once(tmp_path: Path) -> None:
    again = '[[binding]]\ntopic = "brightness"\ntype = "Light"\nfrom = "eye.light"\nto = []\n'
    assert _load(tmp_path, ROBOT + again) == [
        'robot.toml, line 28, binding[2].topic: "eye.light" is bound to "brightness" already; '
        "put all receivers into one list `to`"
    ]


def test_a_port_carries_one_topic(tmp_path: Path) -> None:
    again = '[[binding]]\ntopic = "glare"\ntype = "Light"\nfrom = "eye.light"\nto = ["leg.goal"]\n'
    assert _load(tmp_path, ROBOT + again) == [
        'robot.toml, line 30, binding[2].from: "eye.light" is bound to "brightness" already and carries one topic; '
        "list all receivers in one binding",
        'robot.toml, line 31, binding[2].to[0]: "leg.goal" is bound to "brightness" already and carries one topic; '
        "let all senders publish that topic",
    ]


def test_a_topic_is_reliable_for_all_or_for_none(tmp_path: Path) -> None:
    again = '[[binding]]\ntopic = "speed"\ntype = "Raw"\nfrom = "eye.raw"\nto = []\nreliable = false\n'
    assert _load(tmp_path, ROBOT + again) == [
        'robot.toml, line 32, binding[2].reliable: topic "speed" has reliable = true in another binding; '
        "say the same in both"
    ]


def test_two_ports_may_publish_one_topic(tmp_path: Path) -> None:
    again = '[[binding]]\ntopic = "speed"\ntype = "Raw"\nfrom = "eye.raw"\nto = ["leg.other"]\n'
    assert _load(tmp_path, ROBOT + again) == []


def test_a_binding_without_slots_says_add_them_first(tmp_path: Path) -> None:
    text = ROBOT.replace('name = "eye"', "name = 1").replace('name = "leg"', "name = 2")
    assert any('there is no slot "eye"; add the slot first' in line for line in _load(tmp_path, text))


def test_one_mistake_is_told_once(tmp_path: Path) -> None:
    found = _load(tmp_path, ROBOT.replace('topic = "brightness"', "").replace('from = "eye.light"', "from = 1"))
    assert [line.split(": ")[0] for line in found] == [
        "robot.toml, line 17, binding[0].topic",
        "robot.toml, line 20, binding[0].from",
    ]


@pytest.mark.parametrize("topic", RESERVED_TOPICS)
def test_the_topics_of_plug_and_play_are_never_free_for_all(tmp_path: Path, topic: str) -> None:
    text = ROBOT.replace("[options]", f'[options]\nfree_topics = ["{topic}"]')
    assert _load(tmp_path, text) == [
        f'robot.toml, line 9, options.free_topics[0]: "{topic}" belongs to plug-and-play itself; remove it'
    ]


def test_a_part_that_beats_in_time_cannot_be_delisted(tmp_path: Path) -> None:
    text = ROBOT.replace("[timing]", "[timing]\nbeat_period_s = 3.0")
    assert _load(tmp_path, text) == [
        "robot.toml, line 7, timing: a part that beats every 3 s could be delisted 4 s after a beat "
        "(life 3, tick 2 s); use a tick_period_s of at least 2.25, a higher life, or a shorter beat_period_s"
    ]
    assert _load(tmp_path, text.replace("[timing]", "[timing]\ntick_period_s = 2.25")) == []


SERVICES = Library(
    [
        PartType(
            "EYE",
            "Camera",
            ports=(Port("photo", Direction.SERVE, "Angle -> Text"), Port("light", Direction.PUBLISH, "Light")),
        ),
        PartType("LEG", "Brain", ports=(Port("look", Direction.CALL, "Angle -> Text"),)),
    ]
)
SERVICE = """
[robot]
name = "R"
[[slot]]
name = "eye"
part = "EYE"
[[slot]]
name = "ear"
part = "EYE"
[[slot]]
name = "leg"
part = "LEG"
[[binding]]
topic = "photo"
type = "Angle -> Text"
from = "eye.photo"
to = ["leg.look"]
"""


def test_a_service_joins_a_port_that_serves_with_those_that_call(tmp_path: Path) -> None:
    assert _load(tmp_path, SERVICE, SERVICES) == []


@pytest.mark.parametrize(
    ("before", "after", "words"),
    [
        ('from = "eye.photo"', 'from = "eye.light"', '"eye.light": this port can only publish; use "photo"'),
        ('from = "eye.photo"', 'from = "leg.look"', "part LEG has no port that can serve: choose another slot"),
        ('to = ["leg.look"]', 'to = ["eye.photo"]', '"eye.photo": this port can only serve'),
        ('Angle -> Text"\nfrom', 'Angle -> Light"\nfrom', 'carries messages of type "Angle -> Text"'),
        ('to = ["leg.look"]', 'to = ["leg.look"]\nreliable = false', "requests and replies are always reliable"),
        ('to = ["leg.look"]', 'to = ["leg.look"]\nexport = true', "a service cannot be exported"),
        ('topic = "photo"', 'topic = "msbot_inventory"', 'needs the topic "msbot_inventory_Request", which is in use'),
        (
            'to = ["leg.look"]',
            'to = ["leg.look"]\n[[binding]]\ntopic = "photo"\ntype = "Angle -> Text"\nfrom = "ear.photo"\nto = []',
            'service "photo" is served by "eye.photo" already',
        ),
        (
            'to = ["leg.look"]',
            'to = ["leg.look"]\n[[binding]]\ntopic = "photo_Reply"\ntype = "Light"\nfrom = "ear.light"\nto = []',
            'needs the topic "photo_Reply", which is in use',
        ),
    ],
)
def test_what_is_wrong_with_a_service(tmp_path: Path, before: str, after: str, words: str) -> None:
    assert SERVICE.count(before) == 1
    assert any(words in line for line in _load(tmp_path, SERVICE.replace(before, after), SERVICES))
