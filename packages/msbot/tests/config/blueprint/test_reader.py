"""Reading `robot.toml`: what it becomes, and the structure's mistakes."""

import dataclasses
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from msbot.config.blueprint.blueprint_file_reader import library_folders, load_blueprint, open_blueprint
from msbot.config.blueprint.blueprint_model import PRESETS, Binding, Options, RobotProfile, Slot, SlotPort, Timing
from msbot.config.blueprint.samples import SAMPLE_ROBOT_TOML
from msbot.config.library.part_library import load_library
from msbot_xrce.errors import ConfigError

LIBRARY = load_library()

SMALL = """\
[robot]
name = "R2"
version = "1"
serial_number = "007"
released = "today"
manufacturer = "us"
[[slot]]
name = "eye"
part = "ABCD"
"""


def _complaint(tmp_path: Path, text: str) -> str:
    path = tmp_path / "robot.toml"
    path.write_text(text)
    with pytest.raises(ConfigError) as caught:
        load_blueprint(path, LIBRARY)
    return str(caught.value).replace(f"{tmp_path}/", "")


def test_what_is_left_out_has_the_thesis_value(tmp_path: Path) -> None:
    path = tmp_path / "robot.toml"
    path.write_text(SMALL)
    blueprint = load_blueprint(path, LIBRARY)
    assert blueprint.timing == Timing("thesis", 1.0, 2.0, 3, 5.0)
    assert blueprint.options == Options(explain=True, free_topics=())
    assert blueprint.slots == (Slot("eye", "ABCD"),)
    assert blueprint.bindings == ()
    assert blueprint.source == path
    assert blueprint.topics() == {}
    assert blueprint.slot("eye") == Slot("eye", "ABCD")
    assert blueprint.slot("nose") is None


def test_everything_can_be_said(tmp_path: Path) -> None:
    path = tmp_path / "robot.toml"
    path.write_text(
        SMALL
        + """
[timing]
preset = "fast"
life = 4
profile_period_s = 1
[options]
explain = true
free_topics = ["chat"]
authentication = "key"
[[binding]]
topic = "t"
type = "HelloWorld"
from = "eye.out"
to = ["eye.in"]
reliable = false
[[slot]]
name = "ear"
part = "WXYZ"
[[binding]]
topic = "u"
type = "HelloWorld"
from = "ear.out"
to = []
"""
    )
    blueprint = load_blueprint(path, LIBRARY)
    assert blueprint.timing == Timing("fast", 0.25, 0.5, 4, 1.0)
    assert blueprint.options == Options(explain=True, free_topics=("chat",), authentication="key")
    assert blueprint.bindings[0] == Binding("t", "HelloWorld", SlotPort("eye", "out"), (SlotPort("eye", "in"),), False)
    assert blueprint.bindings[1].targets == ()
    assert blueprint.topics() == {"t": "HelloWorld", "u": "HelloWorld"}


def test_a_blueprint_cannot_be_changed_by_its_users(tmp_path: Path) -> None:
    path = tmp_path / "robot.toml"
    path.write_text(SMALL)
    blueprint = load_blueprint(path, LIBRARY)
    with pytest.raises(dataclasses.FrozenInstanceError):
        blueprint.robot.name = "other"  # type: ignore[misc]  # that it cannot be set is what is tested


def test_the_presets_are_those_of_the_documents() -> None:
    assert PRESETS["thesis"] == Timing("thesis", 1.0, 2.0, 3, 5.0)
    assert PRESETS["fast"] == Timing("fast", 0.25, 0.5, 3, 5.0)


def test_a_missing_file_says_how_to_get_one(tmp_path: Path) -> None:
    path = tmp_path / "robot.toml"
    with pytest.raises(ConfigError) as caught:
        load_blueprint(path, LIBRARY)
    assert str(caught.value) == f"{path}: there is no such file; `msbot init {path}` writes a sample robot there"


def test_broken_toml_names_line_and_column(tmp_path: Path) -> None:
    assert _complaint(tmp_path, SMALL.replace('"R2"', "R2")) == (
        'robot.toml, line 2: column 8: this is not a value; text needs quotes, as in name = "AA"\n    2 | name = R2'
    )


def test_an_empty_file_lacks_everything(tmp_path: Path) -> None:
    assert _complaint(tmp_path, "").splitlines() == [
        "2 problems were found:",
        "  robot.toml, robot: is missing; add a table that begins with [robot]",
        '  robot.toml, slot: a robot needs at least one slot; add [[slot]] with name = "AA" and part = "ABCD"',
    ]


def test_of_the_profile_only_the_name_is_needed(tmp_path: Path) -> None:
    slot = '\n[[slot]]\nname = "AA"\npart = "ABCD"'
    text = _complaint(tmp_path, f"\n[robot]{slot}")
    assert text == 'robot.toml, line 2, robot.name: is missing; add a line such as name = "MSBOT_MASTER"'
    path = tmp_path / "robot.toml"
    path.write_text(f'[robot]\nname = "Rex"{slot}')
    assert load_blueprint(path, LIBRARY).robot == RobotProfile("Rex", "1", "1", "-", "-")


OWN_TYPE = 'number = "LUX-1"\nname = "Light sensor"\n[[port]]\nname = "light"\ndirection = "publish"\ntype = "Light"\n'


def test_a_blueprint_names_its_own_library(tmp_path: Path) -> None:
    (tmp_path / "parts").mkdir()
    (tmp_path / "parts/lux.toml").write_text(OWN_TYPE)
    path = tmp_path / "robot.toml"
    path.write_text('library = ["parts"]\n[robot]\nname = "Rex"\n[[slot]]\nname = "eye"\npart = "LUX-1"')
    blueprint, library = open_blueprint(path)
    assert blueprint.library == ("parts",)
    assert library.require("LUX-1").name == "Light sensor"
    assert library_folders(path) == (tmp_path / "parts",)
    again, _ = open_blueprint(path, tmp_path / "parts")
    assert again == blueprint, "a folder that is named twice is read once"


def test_a_library_that_is_not_there_is_told(tmp_path: Path) -> None:
    path = tmp_path / "robot.toml"
    path.write_text('library = ["nowhere"]\n[robot]\nname = "Rex"\n[[slot]]\nname = "AA"\npart = "ABCD"')
    with pytest.raises(ConfigError, match=r"nowhere: there is no such library folder"):
        open_blueprint(path)
    assert library_folders(tmp_path / "no.toml") == ()


def test_several_mistakes_are_told_at_once_in_order(tmp_path: Path) -> None:
    text = (
        SAMPLE_ROBOT_TOML.replace("[[slot]]", "[[slot]]\ncolour = 1", 1)
        .replace('"EFGH"', '"EFGX"')
        .replace("reliable = true", 'reliable = "yes"')
        .replace('name = "MSBOT_MASTER"', "")
    )
    assert _complaint(tmp_path, text).splitlines() == [
        "4 problems were found:",
        '  robot.toml, line 4, robot.name: is missing; add a line such as name = "MSBOT_MASTER"',
        "  robot.toml, line 27, slot[0].colour: there is no such key here; "
        'known: "description", "local_name", "name", "part", "safe", "settings"',
        '  robot.toml, line 35, slot[1].part: the library has no part number "EFGX"; did you mean "EFGH"?',
        '  robot.toml, line 57, binding[0].reliable: must be true or false, without quotes; it is the text "yes"',
    ]


WRONG = [
    ("[robot]", "[robto]", 'line 1, robto: there is no such key here; did you mean "robot"?'),
    ("[[slot]]", "[[slots]]", 'line 7, slots: there is no such key here; did you mean "slot"?'),
    ("[[slot]]", "[slot]", "line 7, slot: must begin with two brackets, [[slot]], once for each; it is a table"),
    ('version = "1"', "version = 1", "line 3, robot.version: must be text in quotes, for example"),
    ('"today"', "2021-04-08", "it is the date or time 2021-04-08 without quotes"),
    ('"007"', '""', "line 4, robot.serial_number: must not be empty; write for example serial_number ="),
    ('"R2"', f'"{"R" * 255}"', f'line 2, robot.name: "{"R" * 20}..." is 255 bytes long; shorten it to 254'),
    ('name = "eye"', "", 'line 7, slot[0].name: is missing; add a line such as name = "AA"'),
    ('part = "ABCD"', "", 'line 7, slot[0].part: is missing; add a line such as part = "ABCD"'),
    ('"eye"', '"e.ye"', 'line 8, slot[0].name: "e.ye" must not contain "."; use for example "_" in its place'),
    ('"eye"', '"eye"\nlocal_name = ""', "line 9, slot[0].local_name: must not be empty"),
    ('"ABCD"', '"ABCD"\nsettings = 1', "line 10, slot[0].settings: must be a table that begins with [settings]"),
    ("[robot]", "[timing]\nlife = 0\n[robot]", "line 2, timing.life: is 0; it must be 2 to 255"),
    ("[robot]", "[timing]\nlief = 3\n[robot]", 'line 2, timing.lief: there is no such key here; did you mean "life"?'),
    ("[robot]", "[timing]\npreset = 'fats'\n[robot]", 'line 2, timing.preset: "fats" is none of "thesis", "fast"; did'),
    (
        "[robot]",
        "[timing]\nbeat_period_s = -1\n[robot]",
        "line 2, timing.beat_period_s: is -1; it must be 0.02 to 65 s",
    ),
    ("[robot]", "[timing]\ntick_period_s = 0\n[robot]", "timing.tick_period_s: is 0; it must be 0.02 to 3600 s"),
    ("[robot]", "[timing]\nprofile_period_s = inf\n[robot]", "profile_period_s: is inf; it must be 0.1 to 3600 s"),
    ("[robot]", "[options]\nexplain = 1\n[robot]", "line 2, options.explain: must be true or false, without quotes"),
    ("[robot]", "[options]\nfree_topics = 't'\n[robot]", "line 2, options.free_topics: must be a list, for example"),
    ("[robot]", "[options]\nfreee = 1\n[robot]", "line 2, options.freee: there is no such key here; "),
    ("[[slot]]", "[[binding]]\ntopic = 't'\n[[slot]]", "line 7, binding[0].type: is missing; add a line such as type"),
    ("[[slot]]", "[[binding]]\ntopic = 't'\n[[slot]]", "line 7, binding[0].from: is missing; add a line such as from"),
    ("[[slot]]", "[[binding]]\ntopic = 't'\n[[slot]]", 'line 7, binding[0].to: is missing; add a line such as to = ["'),
    (
        "[[slot]]",
        "[[binding]]\nform = 't'\n[[slot]]",
        'binding[0].form: there is no such key here; did you mean "from"?',
    ),
    (
        "[[slot]]",
        "[[binding]]\nros_type = 'std_msgs/Bool'\n[[slot]]",
        "line 8, binding[0].ros_type: says how ROS 2 sees the topic: add ros = true",
    ),
    (
        "[[slot]]",
        "[[binding]]\nros = true\nros_topic = '/my light'\n[[slot]]",
        "line 9, binding[0].ros_topic: ROS 2 takes no topic of that name: names consist of letters, digits, _ and /",
    ),
    (
        "[robot]",
        "[ros]\nglobal_topics = ['/clock', '/tf']\n[robot]",
        'line 2, ros.global_topics: "tf" is none of "clock", "diagnostics", "robot_description"',
    ),
    (
        "[[slot]]",
        "[[binding]]\nexport = 1\n[[slot]]",
        "line 8, binding[0].export: must be true or false, without quotes",
    ),
]


@pytest.mark.parametrize(("right", "wrong", "sentence"), WRONG)
def test_a_mistake_is_told_with_line_path_and_remedy(tmp_path: Path, right: str, wrong: str, sentence: str) -> None:
    assert sentence in _complaint(tmp_path, SMALL.replace(right, wrong, 1))


@given(data=st.data())
def test_whatever_is_written_is_either_a_blueprint_or_a_configuration_error(
    data: st.DataObject, tmp_path_factory: pytest.TempPathFactory
) -> None:
    lines = SAMPLE_ROBOT_TOML.splitlines()
    for _ in range(data.draw(st.integers(1, 4))):
        at = data.draw(st.integers(0, len(lines) - 1))
        lines[at] = data.draw(
            st.sampled_from(
                ["", "[slot.settings]", "[[slot]]", "[timing]", 'name = "AA"', 'to = ["BB.x"]', "life = -1"]
            )
            | st.text(max_size=20)
        )
    path = tmp_path_factory.getbasetemp() / "any.toml"
    path.write_bytes("\n".join(lines).encode("utf-8", "surrogatepass"))
    told = f"{path}"
    try:
        load_blueprint(path, LIBRARY)
    except ConfigError as error:
        told = str(error)
    assert str(path) in told
