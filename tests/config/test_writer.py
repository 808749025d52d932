"""A blueprint that is written down is read as the same blueprint."""

from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from msbot.config import (
    PRESETS,
    SAMPLE_ROBOT_TOML,
    Binding,
    Blueprint,
    Endpoint,
    Library,
    Options,
    Parameter,
    ParameterKind,
    PartType,
    RobotProfile,
    Scalar,
    Slot,
    Timing,
    blueprint_toml,
    load_blueprint,
    load_library,
    preset_of,
)

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
VALUES: st.SearchStrategy[Scalar] = st.one_of(
    st.booleans(),
    st.integers(-(2**63), 2**63 - 1),
    st.floats(allow_nan=False, allow_infinity=False),
    st.text(max_size=20),
)
KINDS = {bool: ParameterKind.BOOL, int: ParameterKind.INT, float: ParameterKind.FLOAT, str: ParameterKind.TEXT}


@settings(deadline=None, max_examples=60)
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
    wire = Binding("t", "HelloWorld", Endpoint("AA", "out"), (Endpoint("AA", "in"),), reliable=False)
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


def test_half_a_wire_is_a_comment(tmp_path: Path) -> None:
    halves = (
        Binding("t", "HelloWorld", Endpoint("", ""), (Endpoint("AA", "in"),)),
        Binding("u", "HelloWorld", Endpoint("AA", "out"), ()),
    )
    text = blueprint_toml(replace(BARE, bindings=halves))
    assert '# topic = "t"' in text
    assert _read_back(text, tmp_path).bindings == ()


def test_the_nearest_preset_is_named() -> None:
    assert preset_of(replace(PRESETS["fast"], preset="thesis")) == "fast"
    assert preset_of(replace(PRESETS["thesis"], life=5)) == "thesis"
