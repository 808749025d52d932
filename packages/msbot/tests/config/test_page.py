"""The pages of the blueprint and of the library name every key; the sample is the one that is written."""

import re
from pathlib import Path

import pytest

from msbot.config import PRESETS, SAMPLE_ROBOT_TOML, load_blueprint, load_library, standard_message_types
from msbot.config.blueprint.check import RESERVED_TOPICS
from msbot.config.library.part_library import _shipped
from msbot_agent.toml.table import Table
from tests import ROOT

DOCS = ROOT / "docs/reference"
PAGE = (DOCS / "blueprint.md").read_text()
LIBRARY_PAGE = (DOCS / "library.md").read_text()

TYPE = """
number = "X"
name = "x"
[supply]
[[pin]]
name = "VCC"
[[type]]
name = "T"
fields = { on = "bool" }
[[port]]
name = "p"
direction = "subscribe"
type = "T"
safe = {}
[[port]]
name = "r"
direction = "publish"
type = "T"
[[port]]
name = "s"
direction = "serve"
request = "T"
reply = "T"
[[parameter]]
name = "q"
type = "int"
default = 1
min = 0
max = 2
[driver]
class = "a:B"
bus = "pins"
[driver.board]
driver = "switch"
sources = ["c"]
pins = { s = "VCC" }
[[driver.pin]]
name = "s"
pin = "VCC"
[[driver.option]]
name = "o"
type = "int"
default = 1
min = 0
max = 2
[[simulator.control]]
name = "c"
type = "number"
start = 1
min = 0
max = 2
[[simulator.reading]]
name = "d"
follows = "c"
[[simulator.publish]]
port = "r"
fields = { on = "d" }
"""
BRIDGE = """
[[bridge]]
world = "canopen"
link = "socketcan:can0"
"""
FREE = {"safe", "ranges", "settings", "fields", "units", "pins"}
"""Tables whose keys are names that the writer of a file chooses."""


def _sections() -> dict[str, str]:
    """Text of the pages by heading, without brackets and backticks."""
    parts = re.split(r"(?m)^##+ (.*)$", PAGE + "\n" + LIBRARY_PAGE)
    sections = {heading.strip("`[]"): text for heading, text in zip(parts[1::2], parts[2::2], strict=True)}
    assert "The keys of [`[[parameter]]`](#parameter)" in sections["driver.option"]
    return sections | {"driver.option": sections["parameter"]}


def _keys(section: str) -> list[str]:
    """The keys of its lists, `KEY, KEY (TYPE): meaning`, and of the table of presets."""
    lists = re.findall(r"(?m)^\* ((?:`\w+`, )*`\w+`) \(", section)
    return re.findall(r"`(\w+)`", " ".join([*lists, *re.findall(r"(?m)^\| `\w+` \|", section)]))


@pytest.fixture
def asked(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> set[tuple[str, str]]:
    """(table, key) for everything the reader looks for."""
    asked: set[tuple[str, str]] = set()
    get = Table._get

    def note(table: Table, key: str) -> object:
        names = [step for step in table.path if isinstance(step, str)]
        if not FREE.intersection(names):
            asked.add((".".join(names), key))
        return get(table, key)

    monkeypatch.setattr(Table, "_get", note)
    _shipped.cache_clear()  # it shall be read now
    folder = tmp_path / "library"
    folder.mkdir()
    (folder / "x.toml").write_text(TYPE)
    library = load_library(folder)
    asked = {(table or "Part type", key) for table, key in asked}
    path = tmp_path / "robot.toml"
    path.write_text(SAMPLE_ROBOT_TOML + BRIDGE)
    load_blueprint(path, library)
    tables = {table for table, _ in asked}
    assert {"", "Part type", "robot", "timing", "options", "slot", "binding", "pin", "port", "parameter"} <= tables
    return asked


def test_every_key_has_a_row_in_its_table(asked: set[tuple[str, str]]) -> None:
    sections = _sections()
    missing = [(table, key) for table, key in asked if table and key not in _keys(sections[table])]
    assert missing == []
    assert {key for table, key in asked if not table} <= set(sections)


def test_the_standard_message_types_have_their_rows() -> None:
    text = _sections()["Standard message types"]
    for message in standard_message_types().values():
        row = re.search(rf"(?m)^\* `{message.name}` \((.*?)\)", text)
        assert row is not None
        assert re.findall(r"`(\w+)`", row[1]) == list(message.fields)


def test_every_part_type_has_its_line() -> None:
    text = _sections()["What MsBOT brings"]
    for part_type in load_library():
        line = re.search(rf"(?m)^\* `{part_type.number}` (.*?): (.*)$", text)
        assert line is not None, part_type.number
        category = re.findall(r"(?m)^\*\*(\w+)\*\*$", text[: line.start()])[-1]
        assert (line[1], category) == (part_type.name, part_type.category.value)
        ports = (part_type.ports[0], part_type.ports[-1])
        assert [port.name for port in ports if f"`{port.name}` {port.type_name}" not in line[2]] == []
    assert text.count("\n* `") == len(load_library())


def test_every_row_is_a_key(asked: set[tuple[str, str]]) -> None:
    sections = _sections()
    sections.pop("Standard message types")
    for heading, text in sections.items():
        for key in _keys(text):
            assert (heading, key) in asked or (heading == key and ("", key) in asked)


def test_the_example_is_a_blueprint(tmp_path: Path) -> None:
    (example,) = re.findall(r"```toml\n(.*?)```", PAGE, re.DOTALL)
    (tmp_path / "parts").mkdir()
    path = tmp_path / "robot.toml"
    path.write_text(example)
    assert [slot.name for slot in load_blueprint(path, load_library()).slots] == ["dial", "fan"]


def test_the_values_of_the_presets_are_right() -> None:
    thesis, fast = PRESETS["thesis"], PRESETS["fast"]
    for key in ("beat_period_s", "tick_period_s", "life", "profile_period_s"):
        assert re.search(rf"\| `{key}` \|.*\| {getattr(thesis, key)} \| {getattr(fast, key)} \|", PAGE)


def test_the_reserved_topics_are_named() -> None:
    assert [topic for topic in RESERVED_TOPICS if f"`{topic}`" not in PAGE] == []


def test_the_message_it_shows_is_what_is_said(tmp_path: Path) -> None:
    path = tmp_path / "robot.toml"
    path.write_text(SAMPLE_ROBOT_TOML.replace('"EFGH"', '"EFGX"').replace('"CC.in"', '"CC.out"'))
    with pytest.raises(Exception, match="2 problems") as caught:
        load_blueprint(path, load_library())
    assert str(caught.value).replace(f"{tmp_path}/", "") in PAGE
