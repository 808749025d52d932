"""A blueprint that is written down is read as the same blueprint."""

from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from msbot.config import (
    NOBODY,
    PRESETS,
    SAMPLE_ROBOT_TOML,
    Binding,
    Blueprint,
    Direction,
    InDds,
    Library,
    Options,
    Parameter,
    ParameterKind,
    PartType,
    RobotProfile,
    Scalar,
    Slot,
    SlotPort,
    Timing,
    blueprint_toml,
    load_blueprint,
    load_library,
    parse_blueprint,
    preset_of,
)
from msbot_xrce.errors import ConfigError
from tests.effort import tries

LIBRARY = load_library()
BARE = Blueprint(RobotProfile("R", "V", "1", "now", "us"), (Slot("AA", "ABCD"),))


def _read_back(text: str, folder: Path, library: Library = LIBRARY) -> Blueprint:
    path = folder / "robot.toml"
    path.write_text(text, encoding="utf-8")
    return replace(load_blueprint(path, library), source=None)


def test_the_sample_comes_back(tmp_path: Path) -> None:
    sample = _read_back(SAMPLE_ROBOT_TOML, tmp_path)
    assert _read_back(blueprint_toml(sample), tmp_path) == sample


NAMES = st.text(st.characters(exclude_categories=["C", "Z"]), min_size=1, max_size=30)
TUPLES = st.lists(NAMES, max_size=2).map(tuple)
VALUES: st.SearchStrategy[Scalar] = st.one_of(
    st.booleans(),
    st.integers(-(2**63), 2**63 - 1),
    st.floats(allow_nan=False, allow_infinity=False),
    st.text(max_size=20),
)
KINDS = {bool: ParameterKind.BOOL, int: ParameterKind.INT, float: ParameterKind.FLOAT, str: ParameterKind.TEXT}


@settings(deadline=None, max_examples=tries(60, 2000))
@given(
    profile=st.tuples(NAMES, NAMES, NAMES, NAMES, NAMES),
    description=st.text(st.characters(exclude_categories=["Cs"]), max_size=40),
    values=st.dictionaries(NAMES, VALUES, max_size=4),
    options=st.builds(Options, st.booleans(), st.lists(NAMES, max_size=2).map(tuple), st.sampled_from(["open", "key"])),
    timing=st.sampled_from([*PRESETS.values(), replace(PRESETS["fast"], life=9, beat_period_s=0.3)]),
)
def test_any_blueprint_comes_back(
    tmp_path_factory: pytest.TempPathFactory,
    profile: tuple[str, str, str, str, str],
    description: str,
    values: dict[str, Scalar],
    options: Options,
    timing: Timing,
) -> None:
    parameters = tuple(Parameter(name, KINDS[type(value)], value) for name, value in values.items())
    library = Library([PartType("ABCD", "thing", parameters=parameters)])
    slot = Slot("AA", "ABCD", "local", description, values)
    blueprint = Blueprint(RobotProfile(*profile), (slot,), (), timing, options)
    assert _read_back(blueprint_toml(blueprint), tmp_path_factory.mktemp("robot"), library) == blueprint


def test_remarks_stand_behind_what_was_made_by_hand(tmp_path: Path) -> None:
    slot = Slot("AA", "ABCD", settings={"a b": 1})
    wire = Binding("t", "HelloWorld", SlotPort("AA", "out"), (SlotPort("AA", "in"),), reliable=False)
    notes = {("AA", "a b"): "set by hand\nby Ann", ("t", ""): "changed by hand"}
    lines = blueprint_toml(replace(BARE, slots=(slot,), bindings=(wire,)), notes).splitlines()
    assert '"a b" = 1  # set by hand by Ann' in lines
    assert lines[lines.index("[[binding]]  # changed by hand") :] == [
        "[[binding]]  # changed by hand",
        'topic = "t"',
        'type = "HelloWorld"',
        'from = "AA.out"',
        'to = ["AA.in"]',
        "reliable = false",
    ]


def test_a_topic_that_nobody_publishes_or_nobody_hears_comes_back(tmp_path: Path) -> None:
    halves = (
        Binding("t", "HelloWorld", NOBODY, (SlotPort("AA", "in"),)),
        Binding(
            "u",
            "HelloWorld",
            SlotPort("AA", "out"),
            (),
            in_dds=InDds(
                export=True,
                ros=True,
                ros_type="std_msgs/msg/String",
                ros_fields=(("message", "data"),),
                ros_topic="/say",
            ),
        ),
    )
    blueprint = replace(BARE, bindings=halves)
    assert _read_back(blueprint_toml(blueprint), tmp_path) == blueprint


def test_a_binding_that_joins_nothing_is_a_mistake(tmp_path: Path) -> None:
    text = blueprint_toml(replace(BARE, bindings=(Binding("t", "HelloWorld", NOBODY, ()),)))
    with pytest.raises(ConfigError, match="from: joins no port: name who publishes"):
        _read_back(text, tmp_path)


def scalars_of(parameter: Parameter) -> st.SearchStrategy[Scalar]:
    """Every value that a parameter takes."""
    match parameter.kind:
        case ParameterKind.BOOL:
            return st.booleans()
        case ParameterKind.TEXT:
            return st.text(st.characters(exclude_categories=["Cs"]), max_size=20)
        case ParameterKind.PART:
            return st.sampled_from(["", f"LED {parameter.name}: s={parameter.name[-1]}"])
        case ParameterKind.INT:
            least, most = (None if end is None else int(end) for end in (parameter.least, parameter.most))
            return st.integers(least, most)
        case ParameterKind.FLOAT:
            return st.floats(parameter.least, parameter.most, allow_nan=False, allow_infinity=False)


@st.composite
def blueprints(draw: st.DrawFn) -> Blueprint:
    """Any robot of the library: slots of any types with any settings, and any wires that fit."""
    texts = st.text(st.characters(exclude_categories=["Cs"]), max_size=20)
    names = draw(st.lists(NAMES.filter(lambda name: "." not in name), min_size=1, max_size=4, unique=True))
    slots = []
    for name in names:
        part_type = draw(st.sampled_from(list(LIBRARY)))
        values = {one.name: draw(scalars_of(one)) for one in part_type.parameters if draw(st.booleans())}
        local_name = draw(st.one_of(st.just(""), NAMES))
        slots.append(Slot(name, part_type.number, local_name, draw(texts), values))
    ports = [(slot, port) for slot in slots for port in LIBRARY.require(slot.part_number).ports]
    bindings = []
    for number, type_name in enumerate(sorted({port.type_name for _, port in ports})):
        ends = [(SlotPort(slot.name, port.name), port.direction) for slot, port in ports if port.type_name == type_name]
        sources = [end for end, direction in ends if direction is Direction.PUBLISH]
        wanted = draw(st.lists(st.sampled_from([end for end, direction in ends if end not in sources] or [NOBODY])))
        targets = tuple(dict.fromkeys(target for target in wanted if target.slot))
        topic, reliable = f"{number} {draw(NAMES)}", draw(st.booleans())
        senders = draw(st.lists(st.sampled_from(sources), unique=True)) if sources else []
        for source in senders or [NOBODY]:
            if source.slot or targets:
                bindings.append(Binding(topic, type_name, source, targets, reliable))
    options = draw(st.builds(Options, st.booleans(), TUPLES, st.sampled_from(["open", "key"])))
    timing = draw(st.sampled_from(list(PRESETS.values())))
    profile = RobotProfile(*(draw(NAMES) for _ in range(5)))
    return Blueprint(profile, tuple(slots), tuple(bindings), timing, options, draw(TUPLES))


@settings(deadline=None, max_examples=tries(60, 2000))
@given(blueprints())
def test_any_robot_of_the_library_comes_back_whole(blueprint: Blueprint) -> None:
    assert replace(parse_blueprint(blueprint_toml(blueprint), LIBRARY), source=None) == blueprint


def test_the_nearest_preset_is_named() -> None:
    assert preset_of(replace(PRESETS["fast"], preset="thesis")) == "fast"
    assert preset_of(replace(PRESETS["thesis"], life=5)) == "thesis"
