"""Who may be on one CAN bus: bridges with each other, and with the robot's own parts; and how busy it will be."""

from __future__ import annotations

import asyncio
import json
from pathlib import Path
from uuid import uuid4

import pytest
from click.testing import CliRunner, Result

from msbot.cli.blueprint.files import check_command
from msbot.cli.bus.bus_commands import command as bus_command
from msbot.config import SAMPLE_ROBOT_TOML, BridgeTable
from msbot_agent.link.can.protocol import CanIds
from msbot_agent.link.can.protocol.ids import Assign, Beacon, assign_frame, beacon_frame, join_frame
from msbot_bridges.bridge import BridgeLink, BridgeTraffic, CanClaim, Identifiers, WorldKind, worlds
from msbot_bridges.canbus import OnBus, check_one_bus, open_bus, robot_on_bus
from msbot_bridges.cli.bridge_command import command as bridge_command
from msbot_bridges.cli.bridge_runner import RUNNER
from msbot_xrce.errors import ConfigError
from tests.bridges.hosts import Host, running

pytest.importorskip("canopen")
pytest.importorskip("dronecan")

import can

CAN0 = "socketcan:can0?bitrate=500000"


@pytest.mark.parametrize(
    ("tables", "links", "words"),
    [
        (
            [("canopen", CAN0)],
            ["can:can0"],
            r"PDOs \(0x180 to 0x57f\) of canopen and master to parts \(0x181 to 0x1f8\)",
        ),
        (
            [("canopen", "msbot:x")],
            ["udp:127.0.0.1:0", "sim:x"],
            "on msbot:x and the robot's own parts on sim:x are on",
        ),
        (
            [("dronecan", "socketcan:can0")],
            ["can:can0?bitrate=500000"],
            "ASSIGN .* in 29 bits.* of the robot's own parts",
        ),
        ([("dronecan", "slcan:/dev/ttyACM0")], ["can:slcan:/dev/ttyACM0"], "use a bus for each, with an adapter"),
        ([("cyphal", CAN0), ("dronecan", CAN0)], [], "of cyphal and .* of dronecan can have the same identifier"),
        ([("canopen", CAN0)], ["can:can0?bitrate=250000"], "cannot have 500000 and 250000 bit/s; give both the same"),
        ([("canopen", CAN0)], ["can:can0?fd=1"], "canopen would destroy the CAN FD frames of the robot's own parts"),
        ([("dronecan", CAN0)], ["canfd:can0"], "would destroy the CAN FD frames"),
        ([("canopen", CAN0), ("dronecan", "socketcan:can0?bitrate=1000000")], [], "500000 and 1000000 bit/s"),
        ([("canopen", "msbot:x?bitrate=123456")], [], "its devices have no 123456 bit/s, but one of 10000"),
        ([("canopen", "msbot:x"), ("canopen", "msbot:x?bitrate=500000")], [], "one finds all devices"),
    ],
)
def test_a_bus_on_which_two_disturb_each_other_is_refused(
    tables: list[tuple[str, str]], links: list[str], words: str
) -> None:
    with pytest.raises(ConfigError, match=words):
        RUNNER.check([BridgeTable(*one) for one in tables], links)


def test_buses_that_can_be_are_taken() -> None:
    bridges = [BridgeTable("canopen", CAN0), BridgeTable("dronecan", "socketcan:can0"), BridgeTable("mqtt", "mqtt://x")]
    RUNNER.check(bridges, ["can:can1?bitrate=250000", "sim:can0", "can-legacy:can0", "udp:127.0.0.1:0"])


def test_a_world_apart_may_share_the_bus_of_the_robots_parts() -> None:
    robot = robot_on_bus("sim:x")
    assert robot is not None
    apart = OnBus("apart", "msbot:x", CanClaim((Identifiers("all", 0x400, 0x6FF),)))
    check_one_bus([robot, apart])


def test_the_robots_identifiers_are_those_of_its_frames() -> None:
    robot = robot_on_bus("can:can0")
    assert robot is not None
    ids = CanIds()
    frames = [join_frame(bytes(range(1, 9)), 3, ids), assign_frame(Assign(bytes(8), 120, 16383, 1), ids)]
    for frame in frames:
        assert any(one.extended and one.first <= frame.can_id <= one.last for one in robot.claim.identifiers)


@pytest.mark.parametrize("world", ["canopen", "cyphal", "dronecan"])
def test_the_traffic_of_a_world_has_identifiers_of_that_world(world: str) -> None:
    claim = worlds()[world].can
    assert claim is not None
    for one in claim.traffic:
        assert any(ids.first <= one.can_id <= ids.last for ids in claim.identifiers), one
    assert claim.bits_per_s(2) - claim.bits_per_s(1) == pytest.approx(claim.bits_per_s(1) - claim.bits_per_s(0))


def blueprint(folder: Path, *bridges: str) -> str:
    tables = "".join(f"\n[[bridge]]\n{one}\n" for one in bridges)
    (folder / "robot.toml").write_text(SAMPLE_ROBOT_TOML + tables)
    return str(folder / "robot.toml")


def test_msbot_check_refuses_a_shared_bus(tmp_path: Path) -> None:
    path = blueprint(tmp_path, 'world = "canopen"\nlink = "msbot:classroom"')
    assert CliRunner().invoke(check_command, [path, "--link", "udp:127.0.0.1:0"]).exit_code == 0
    refused = CliRunner().invoke(check_command, [path, "--link", "sim:classroom"])
    assert isinstance(refused.exception, ConfigError)
    assert "robot.toml, bridge: canopen on msbot:classroom" in str(refused.exception)
    told = CliRunner().invoke(check_command, [path, "--link", "sim:classroom", "--json"])
    assert (told.exit_code, json.loads(told.output)["problems"][0]["key"]) == (2, "bridge")
    wrong = CliRunner().invoke(check_command, [path, "--link", "cam:classroom"])
    assert "unknown kind of link" in str(wrong.exception)


def test_msbot_bridge_refuses_the_bus_of_its_robot() -> None:
    refused = CliRunner().invoke(bridge_command, ["dronecan", "--link", "msbot:x", "--robot-link", "sim:x"])
    assert "are on one bus" in str(refused.exception)


def test_the_forecast_has_the_buses_of_bridges(tmp_path: Path) -> None:
    path = blueprint(
        tmp_path,
        'world = "canopen"\nlink = "msbot:x?bitrate=125000"\nsimulate = ["drive", "io"]',
        'world = "dronecan"\nlink = "msbot:x"',
    )
    text = CliRunner().invoke(bus_command, ["load", path]).output
    assert text.splitlines()[-1].startswith("Besides, canopen and dronecan on msbot:x?bitrate=125000, with 3 devices:")
    (bus,) = json.loads(CliRunner().invoke(bus_command, ["load", path, "--json"]).output)["bridge_buses"]
    assert (bus["worlds"], bus["devices"]) == (["canopen", "dronecan"], 3)
    assert 1 < bus["load_percent"] < 20


APART = WorldKind(
    "a world that may share the bus of the robot's parts",
    "msbot:x",
    lambda _: None,  # type: ignore[arg-type,return-value]
    can=CanClaim((Identifiers("all", 0x400, 0x6FF),), traffic=(BridgeTraffic("reports", 0x400, 8, 600),)),
)


def test_the_load_of_a_shared_bus_has_the_robots_own_parts(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("msbot_bridges.cli.bridge_runner.worlds", lambda: {"apart": APART, **worlds()})

    def check(rate: int, link: str) -> Result:
        path = blueprint(tmp_path, f'world = "apart"\nlink = "msbot:x?bitrate={rate}"')
        return CliRunner().invoke(check_command, [path, "--link", link])

    told = check(50_000, "sim:x")
    assert "apart and the robot's own parts on msbot:x?bitrate=50000: about" in str(told.exception)
    assert "does not fit the bus: use more bits a second" in str(told.exception)
    (alone,) = [line for line in check(80_000, "sim:y").output.splitlines() if "apart" in line]
    assert alone.startswith("hint: apart on msbot:x?bitrate=80000: about 8")
    assert "apart" not in check(500_000, "sim:x").output


def test_an_adapter_with_two_names_is_one(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("os.path.realpath", lambda path: path.replace("by-id/acme", "ttyACM0"))
    with pytest.raises(ConfigError, match="are on one bus"):
        RUNNER.check([BridgeTable("canopen", "slcan:/dev/by-id/acme")], ["can:slcan:/dev/ttyACM0"])


UNREADABLE = "cannot be read"
"""Two DroneCAN nodes of one id spoil each other's transfers, too."""


async def said(host: Host) -> str:
    while UNREADABLE in (words := await host.said.get()):
        pass
    return words


@pytest.mark.parametrize("world", ["canopen", "dronecan"])
async def test_who_is_on_the_wire_by_another_adapter_is_noticed(world: str) -> None:
    link = BridgeLink(f"msbot:{uuid4().hex[:12]}")
    kind = worlds()[world]
    with open_bus(link.address) as bus:  # acknowledges: two nodes alone that send the same frames never do
        async with running(kind.open(link)) as one, running(kind.open(link)) as other:
            for host in (one, other):
                assert "somebody else on this bus is node 12" in await said(host)
            beacon = beacon_frame(Beacon(0, 7, 9), CanIds())
            message = can.Message(arbitration_id=beacon.can_id, data=beacon.data, is_extended_id=False)
            for _ in range(2):
                await asyncio.to_thread(bus.send, message)
            assert "parts of MsBOT are on this bus, too" in await said(one)
        while not one.said.empty():
            assert UNREADABLE in one.said.get_nowait(), "the rest is said once"
