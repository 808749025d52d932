"""`[[bridge]]`: read, written, kept in the database, compared; refused where nothing runs bridges."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from msbot.cli.run import bridges_beside
from msbot.config import SAMPLE_ROBOT_TOML, BridgeTable, load_library, parse_blueprint
from msbot.config.blueprint.blueprint_file_writer import blueprint_toml
from msbot.config.blueprint.differences import differences
from msbot.registry import open_registry
from msbot_agent.startup.extensions import Extensions
from msbot_xrce.errors import ConfigError

LIBRARY = load_library()
PLAIN = parse_blueprint(SAMPLE_ROBOT_TOML, LIBRARY)
TABLE = BridgeTable("canopen", "msbot:x", {"eds": "sheets", "count": "3"}, ("drive node=7", "io"))
BRIDGED = parse_blueprint(
    SAMPLE_ROBOT_TOML + '\n[[bridge]]\nworld = "canopen"\nlink = "msbot:x"\n'
    'options = { eds = "sheets", count = 3 }\nsimulate = ["drive node=7", "io"]\n',
    LIBRARY,
)


def test_they_are_read_written_and_kept(tmp_path: Path) -> None:
    assert BRIDGED.bridges == (TABLE,)
    assert parse_blueprint(blueprint_toml(BRIDGED), LIBRARY).bridges == (TABLE,)
    with open_registry(tmp_path / "robot.db") as registry:
        for blueprint in (BRIDGED, PLAIN):
            record = registry.robots.apply_blueprint(blueprint, LIBRARY)
            assert registry.robots.blueprint(record).bridges == blueprint.bridges


def test_they_are_compared() -> None:
    assert [str(one).partition(" (")[0] for one in differences(PLAIN, BRIDGED)] == [
        "+ bridge, canopen msbot:x: eds = sheets, count = 3, drive node=7, io"
    ]
    assert [one.change for one in differences(BRIDGED, PLAIN)] == ["removed"]
    other = replace(BRIDGED, bridges=(replace(TABLE, simulate=()),))
    assert [one.change for one in differences(BRIDGED, other)] == ["changed"]


def test_a_table_without_a_link_is_refused() -> None:
    with pytest.raises(ConfigError, match=r"bridge\[1\]\.link: is missing|link"):
        parse_blueprint(SAMPLE_ROBOT_TOML + '\n[[bridge]]\nworld = "canopen"\n', LIBRARY)


def test_without_anything_that_runs_them_they_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(bridges_beside, "extensions", lambda: Extensions(lambda: []))
    bridges_beside.check_bridges(PLAIN)
    with pytest.raises(ConfigError, match=r"pip install 'msbot\[bridges\]'"):
        bridges_beside.check_bridges(BRIDGED)
