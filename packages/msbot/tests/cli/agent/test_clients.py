"""`msbot clients`: tables and JSON."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
from click.testing import CliRunner

from msbot_agent.agent import AgentStatus, ClientView, LinkView, ObjectView, StreamView
from msbot_agent.cli.agent import clients
from msbot_agent.cli.agent import clients as clients_view
from msbot_agent.cli.agent.clients import command
from msbot_xrce.errors import ConfigError

TROUBLE = "HelloWorldTopic: RELIABILITY: the reader asks for RELIABLE, the writer offers BEST_EFFORT"

BOARD = ClientView(
    key=0xAABBCCDD,
    session_id=0x81,
    link="serial:auto",
    address="/dev/ttyUSB0 address 1",
    mtu=508,
    age_s=312.0,
    silent_s=0.2,
    objects=(
        ObjectView(0x11, "participant", None, True),
        ObjectView(0x12, "topic", "HelloWorldTopic", True),
        ObjectView(0x15, "datawriter", "HelloWorldTopic", True, (TROUBLE,)),
        ObjectView(0x26, "datareader", "secret", False),
    ),
    packets_in=30,
    packets_out=31,
    bytes_in=1000,
    bytes_out=2000,
    published=12,
    delivered=0,
    waiting=0,
    streams=(StreamView(0x80, False, 12, 0, 0), StreamView(0x80, True, 34, 2, 5), StreamView(0x01, False, None, 0, 0)),
    resent=3,
    repeated=1,
    dropped={"broken WRITE_DATA": 2},
    refused={"secret": 7},
)
GONE = ClientView(
    key=2,
    session_id=1,
    link="serial:auto",
    address="/dev/ttyUSB0 address 2",
    mtu=508,
    age_s=5.0,
    silent_s=4.0,
    objects=(),
    packets_in=1,
    packets_out=1,
    bytes_in=24,
    bytes_out=19,
    published=0,
    delivered=0,
    waiting=0,
    gone="gone: port unplugged",
)
STATUS = AgentStatus(
    pid=4711,
    what="agent",
    name="serial:auto",
    up_s=7300.0,
    links=(LinkView("serial:auto", 31, 32, 1024, 2019, {"wrong check sum": 3}),),
    topics=(("HelloWorldTopic", 12, 0),),
    dropped={"packet without a session": 4},
    clients=(GONE, BOARD),
)
MASTER = AgentStatus(1, "master", "MSBOT_MASTER MSBOT_V1", 3.0, (), (), {}, ())


@pytest.fixture
def shown(capsys: pytest.CaptureFixture[str]) -> Callable[..., str]:
    def show(*statuses: AgentStatus) -> str:
        clients_view.show(statuses)
        return capsys.readouterr().out

    return show


def test_the_table_says_who_is_there_and_what_went_wrong(shown: Callable[..., str]) -> None:
    text = shown(STATUS, MASTER)
    assert "agent on serial:auto, process 4711, up 2 h: 2 clients" in text
    assert "master of MSBOT_MASTER MSBOT_V1, process 1, up 3.0 s: no clients" in text
    row, *more = [line for line in text.splitlines() if line.startswith("AABBCCDD ")]
    for words in ("81", "/dev/ttyUSB0 address 1", "5 min", "0.2 s ago", " 12 ", " 30 "):
        assert words in row
    for words in (
        "objects: 4: HelloWorldTopic",
        "(secret)",
        "2 x broken WRITE_DATA, 7 x not allowed on secret",
        "(2 on their way)",
        "01 in -",
    ):
        assert words in "\n".join(more)
    assert "gone: port unplugged" in text
    assert "packets of nobody: 4 x packet without a session" in text
    assert "serial:auto: 3 x wrong check sum" in text
    assert f"AABBCCDD: {TROUBLE}" in text


def test_a_master_says_what_is_wrong_with_its_database() -> None:
    master = replace(
        STATUS,
        what="master",
        details={"trouble": "the database robot.db has no room"},
        dropped={},
        links=(),
        clients=(),
    )
    assert clients_view.footlines(master) == ["The robot goes on from memory: the database robot.db has no room"]
    assert clients_view.footlines(replace(master, details={})) == []


def test_one_client_is_said_in_the_singular() -> None:
    status = AgentStatus(1, "agent", "udp:[::1]:8888", 0.1, (), (), {}, (GONE,))
    assert clients_view.headline(status) == "agent on udp:[::1]:8888, process 1, up 0.1 s: 1 client"


@pytest.mark.parametrize(
    ("seconds", "words"),
    [(0.04, "0.0 s"), (9.94, "9.9 s"), (12, "12 s"), (119, "119 s"), (120, "2 min"), (7200, "2 h"), (200_000, "2 d")],
)
def test_times_are_said_as_people_do(seconds: float, words: str) -> None:
    assert clients_view.duration(seconds) == words


def test_streams_are_said_by_number_and_direction() -> None:
    assert clients_view.streams_words(BOARD.streams) == "01 in -, 80 in 12 out 34 (2 on their way) (5 wait)"
    assert clients_view.streams_words(()) == ""


def test_json_has_everything(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(clients, "read_statuses", lambda: [STATUS])
    done = CliRunner().invoke(command, ["--json"])
    assert done.exit_code == 0
    (status,) = json.loads(done.stdout)
    assert (status["pid"], status["what"], status["name"], status["up_s"]) == (4711, "agent", "serial:auto", 7300.0)
    assert status["links"][0]["dropped"] == {"wrong check sum": 3}
    assert status["topics"] == [{"name": "HelloWorldTopic", "published": 12, "delivered": 0}]
    gone, board = status["clients"]
    assert gone["gone"] == "gone: port unplugged"
    assert (board["key"], board["session"], board["address"]) == ("AABBCCDD", "81", "/dev/ttyUSB0 address 1")
    writer = {"id": "0015", "kind": "datawriter", "topic": "HelloWorldTopic", "attached": True, "troubles": [TROUBLE]}
    assert board["objects"][2] == writer
    assert board["streams"][1] == {"id": "80", "direction": "out", "last": 34, "unacked": 2, "waiting": 5}
    assert board["dropped"] == {"broken WRITE_DATA": 2}
    assert board["refused"] == {"secret": 7}
    assert set(board) >= set(ClientView.__slots__) - {"session_id"}


def test_a_table_is_printed_without_a_terminal_too(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(clients, "read_statuses", lambda: [STATUS])
    done = CliRunner().invoke(command)
    assert done.exit_code == 0
    assert "AABBCCDD" in done.stdout


def test_nobody_runs(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    done = CliRunner().invoke(command)
    assert (done.exit_code, done.stdout) == (0, "No agent or master of yours is running on this computer.\n")
    assert json.loads(CliRunner().invoke(command, ["--json"]).stdout) == []


def test_a_folder_of_somebody_else_is_a_mistake_of_the_user(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    (tmp_path / "msbot").mkdir()
    (tmp_path / "msbot").chmod(0o777)
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    assert isinstance(CliRunner().invoke(command).exception, ConfigError)
