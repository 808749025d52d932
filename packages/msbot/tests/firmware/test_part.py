"""The firmware's part in a robot of MsBOT: both steps, beats, settings, wires, STOP, keys, faults; in virtual time."""

from __future__ import annotations

import asyncio
import hashlib
import hmac
from pathlib import Path
from random import Random

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from msbot.part.join.home import VERSION
from tests.firmware.building import SOURCES
from tests.firmware.c_part import CPart, Described, PartState
from tests.firmware.msbot_side import MsbotError, Part, SlotPort, Switch, prove
from tests.firmware.pipe import Firmware
from tests.firmware.robot import Robot, play
from tests.registry.hand import Hand

UID = bytes(range(1, 9))
ON, OFF = b"\x01", b"\x00"
DRIVE, LEVEL = 0, 1
SOON_S = 0.1


def board(firmware: Firmware, **more: object) -> CPart:
    return CPart(firmware, Described(uid=UID, **more))  # type: ignore[arg-type]  # words of Described


def lever(robot: Robot) -> Part:
    return robot.plug_python(Part("TOGGLE", local_name="lever", random=Random(1)), "lever")


def relay(robot: Robot, story: list[bool]) -> Part:
    part = Part("RELAY-1", local_name="relay", random=Random(2))
    part.on("on", Switch)(lambda message: story.append(message.on))
    return robot.plug_python(part, "relay")


@pytest.mark.parametrize("codec", [True, False], ids=["compressed", "plain"])
@pytest.mark.parametrize(("bitrate", "fd"), [(125_000, False), (500_000, False), (1_000_000, False), (500_000, True)])
def test_it_plugs_itself_in_and_beats(firmware: Firmware, tmp_path: Path, bitrate: int, fd: bool, codec: bool) -> None:
    async def scene(robot: Robot) -> None:
        part = robot.plug(board(firmware, fd=fd, codec=codec))
        await asyncio.sleep(10)
        assert robot.state() == "active"
        assert robot.nature() == "simulated"
        assert robot.versions() == ("C", VERSION, "1.2")
        assert part.story == [
            "safe",
            "RECOGNISING",
            "CLAIMING",
            "CONFIGURING",
            "drive.safe.on=false",
            "invert=false",
            "repeat_s=5",
            "ACTIVE",
        ]
        assert part.beats in (9, 10)
        assert (part.missed_beats, part.dropped) == (0, (0, 0, 0))
        assert robot.driver.counters.errors == 0
        assert robot.master_link.counters.dropped == {}

    play(tmp_path, scene, bitrate=bitrate, fd=fd, codec=codec)


def test_the_page_says_how_long_it_takes_to_plug_itself_in(firmware: Firmware, tmp_path: Path) -> None:
    """Exact, in virtual time; when this fails, the table in docs/explain/firmware.md is no longer true."""
    page = (SOURCES.parents[1] / "docs" / "explain" / "firmware.md").read_text()
    buses = {"125k": 125_000, "250k": 250_000, "500k": 500_000, "1000k": 1_000_000, "FD 500k/2M": 500_000}
    for bus, bitrate in buses.items():
        took: list[float] = []
        for codec in (True, False):
            fd = bus.startswith("FD")

            async def scene(robot: Robot, *, fd: bool = fd, codec: bool = codec, took: list[float] = took) -> None:
                robot.plug(board(firmware, fd=fd, codec=codec))
                await asyncio.sleep(1)
                took.append(robot.plug_in_to_active_ms())

            (tmp_path / f"{bitrate}{fd}{codec}").mkdir()
            play(tmp_path / f"{bitrate}{fd}{codec}", scene, bitrate=bitrate, fd=fd, codec=codec)
        assert f"| {bus} | {took[0]:.1f} | {took[1]:.1f} |" in page


def test_it_hears_and_is_heard(firmware: Firmware, tmp_path: Path) -> None:
    async def scene(robot: Robot) -> None:
        story: list[bool] = []
        hand = lever(robot)
        relay(robot, story)
        part = robot.plug(board(firmware))
        await asyncio.sleep(1)
        for on in (True, False, True):
            assert hand.publish("on", Switch(on=on))
            assert part.publish(LEVEL, bytes((not on,)))
            await asyncio.sleep(SOON_S)
        assert part.heard == [(DRIVE, ON), (DRIVE, OFF), (DRIVE, ON)]
        assert story == [False, True, False]
        assert not part.publish(DRIVE, ON), "it is for messages that come in"

    play(tmp_path, scene)


def test_nothing_is_published_before_it_is_active(firmware: Firmware, tmp_path: Path) -> None:
    async def scene(robot: Robot) -> None:
        part = robot.plug(board(firmware))
        assert not part.publish(LEVEL, ON)
        await asyncio.sleep(1)
        assert part.publish(LEVEL, ON)

    play(tmp_path, scene)


def test_a_setting_reaches_it_at_once_and_alone(firmware: Firmware, tmp_path: Path) -> None:
    async def scene(robot: Robot) -> None:
        part = robot.plug(board(firmware))
        await asyncio.sleep(1)
        part.story.clear()
        robot.set("board", "repeat_s", 0.5)
        await asyncio.sleep(SOON_S)
        assert part.story == ["repeat_s=0.5"]
        robot.set("board", "invert", True)
        await asyncio.sleep(SOON_S)
        assert part.story == ["repeat_s=0.5", "invert=true"]

    play(tmp_path, scene)


def test_a_configuration_that_comes_in_pieces(firmware: Firmware, tmp_path: Path) -> None:
    """It is longer than a message, the first time and when a setting has changed."""
    topics = [("long/" * 24 + name, name) for name in ("lever", "level")]
    changes = tuple((f'topic = "{name}"', f'topic = "{topic}"') for topic, name in topics)

    async def scene(robot: Robot) -> None:
        hand = lever(robot)
        part = robot.plug(board(firmware))
        await asyncio.sleep(1)
        assert part.state is PartState.ACTIVE
        part.story.clear()
        robot.set("board", "repeat_s", 0.5)
        await asyncio.sleep(SOON_S)
        assert part.story == ["repeat_s=0.5"]
        hand.publish("on", Switch(on=True))
        await asyncio.sleep(SOON_S)
        assert part.heard == [(DRIVE, ON)]

    play(tmp_path, scene, changes=changes)


def test_a_wire_can_be_moved_while_it_runs(firmware: Firmware, tmp_path: Path) -> None:
    other = '\n[[slot]]\nname = "other"\npart = "TOGGLE"\nlocal_name = "other"\n\n[[binding]]\ntopic = "lever"'
    wire = '\n[[binding]]\ntopic = "other"\ntype = "Switch"\nfrom = "other.on"\nto = []\n\n[[binding]]\ntopic = "level"'
    changes = (
        ('name = "lever"\npart = "TOGGLE"', 'name = "lever"\npart = "TOGGLE"\nlocal_name = "lever"'),
        ('\n[[binding]]\ntopic = "lever"', other),
        ('\n[[binding]]\ntopic = "level"', wire),
    )

    async def scene(robot: Robot) -> None:
        first = lever(robot)
        second = robot.plug_python(Part("TOGGLE", local_name="other", random=Random(9)), "other")
        part = robot.plug(board(firmware))
        await asyncio.sleep(1)
        first.publish("on", Switch(on=True))
        second.publish("on", Switch(on=False))
        await asyncio.sleep(SOON_S)
        assert part.heard == [(DRIVE, ON)]
        Hand(robot.registry).unbind(robot.record, "lever", SlotPort("board", "drive"), "test")
        Hand(robot.registry).bind(
            robot.record, "other", "test", type_name="Switch", source=None, targets=[SlotPort("board", "drive")]
        )
        for slot in ("board", "lever", "other"):
            robot.master.inventory.configuration_changed(slot)
        await asyncio.sleep(SOON_S)
        first.publish("on", Switch(on=True))
        second.publish("on", Switch(on=False))
        await asyncio.sleep(SOON_S)
        assert part.heard == [(DRIVE, ON), (DRIVE, OFF)]

    play(tmp_path, scene, changes=changes)


def test_put_into_another_slot_it_fetches_that_ones_configuration(firmware: Firmware, tmp_path: Path) -> None:
    """Also when both configurations have the same version."""
    slot = '[[slot]]\nname = "board"\npart = "PIN-BOARD"\n'
    spare = '[[slot]]\nname = "spare"\npart = "PIN-BOARD"\n\n[slot.settings]\nrepeat_s = 0.5\n'

    async def scene(robot: Robot) -> None:
        part = robot.plug(board(firmware))
        await asyncio.sleep(1)
        part.story.clear()
        now = asyncio.get_running_loop().time()
        (info,) = robot.master.inventory.view(now)
        robot.master.inventory.rearrange({info.client_key: "spare"}, now, "moved by ann")
        await asyncio.sleep(SOON_S)
        assert part.state is PartState.ACTIVE
        assert "repeat_s=0.5" in part.story

    play(tmp_path, scene, changes=((slot, slot + 'local_name = "board"\n\n' + spare),))


def test_stop_holds_until_go(firmware: Firmware, tmp_path: Path) -> None:
    async def scene(robot: Robot) -> None:
        hand = lever(robot)
        part = robot.plug(board(firmware))
        await asyncio.sleep(1)
        part.story.clear()
        robot.master.say_stop("ann")
        await asyncio.sleep(SOON_S)
        assert part.story == ["safe"]
        assert part.stopped
        assert robot.master.stop.silent == (), "the board has confirmed it, too"
        hand.publish("on", Switch(on=True))
        await asyncio.sleep(SOON_S)
        assert part.heard == []
        robot.master.say_go("ann")
        await asyncio.sleep(SOON_S)
        assert not part.stopped
        hand.publish("on", Switch(on=True))
        await asyncio.sleep(SOON_S)
        assert part.heard == [(DRIVE, ON)]

    play(tmp_path, scene)


@pytest.mark.parametrize("holds", [False, True])
def test_a_stop_heard_on_the_way_into_the_robot_holds_only_if_it_does_there(
    firmware: Firmware, tmp_path: Path, holds: bool
) -> None:
    """On a bus everybody hears STOP; GO is told to the parts of the robot, and the board is not yet one of them."""

    async def scene(robot: Robot) -> None:
        hand = lever(robot)
        await asyncio.sleep(1)
        part = robot.plug(board(firmware))
        while part.state is PartState.LOOKING:  # noqa: ASYNC110 - in virtual time
            await asyncio.sleep(0.0001)
        robot.master.say_stop("ann")
        await asyncio.sleep(0.0005)
        assert part.stopped
        assert part.state in (PartState.RECOGNISING, PartState.CLAIMING)
        if not holds:
            robot.master.say_go("ann")
        await asyncio.sleep(1)
        assert robot.state() == "active"
        assert part.stopped is holds
        if holds:
            robot.master.say_go("ann")
            await asyncio.sleep(SOON_S)
        hand.publish("on", Switch(on=True))
        await asyncio.sleep(SOON_S)
        assert part.heard == [(DRIVE, ON)]

    play(tmp_path, scene)


def test_while_its_stop_button_is_pressed_nobody_can_say_go(firmware: Firmware, tmp_path: Path) -> None:
    async def scene(robot: Robot) -> None:
        hand = lever(robot)
        part = robot.plug(board(firmware))
        await asyncio.sleep(2)
        part.hold_stop(True)
        await asyncio.sleep(2)
        assert hand.stopped
        assert robot.master.stop.silent == ()
        with pytest.raises(MsbotError, match="STOP is still said by board"):
            robot.master.say_go("ann")
        part.hold_stop(False)
        await asyncio.sleep(SOON_S)
        assert part.stopped
        robot.master.say_go("ann")
        await asyncio.sleep(2)
        assert not part.stopped
        assert not hand.stopped
        assert not robot.master.stop.stopped

    play(tmp_path, scene)


def test_it_can_say_stop_itself(firmware: Firmware, tmp_path: Path) -> None:
    async def scene(robot: Robot) -> None:
        hand = lever(robot)
        part = robot.plug(board(firmware))
        await asyncio.sleep(1)
        part.say_stop()
        await asyncio.sleep(SOON_S)
        assert part.stopped
        assert hand.stopped
        assert robot.master.stop.stopped
        assert robot.master.stop.silent == ()
        await asyncio.sleep(5)
        robot.master.say_go("ann")
        await asyncio.sleep(SOON_S)
        assert not part.stopped

    play(tmp_path, scene)


def test_its_safe_value_when_the_master_dies_and_back_with_the_next_one(firmware: Firmware, tmp_path: Path) -> None:
    async def scene(robot: Robot) -> None:
        part = robot.plug(board(firmware))
        await asyncio.sleep(1)
        part.story.clear()
        await robot.kill_master()
        await asyncio.sleep(2.4)
        assert part.story == []
        await asyncio.sleep(1.2)
        assert part.story == ["safe", "LOST"]
        await robot.new_master()
        await asyncio.sleep(1)
        assert part.story[2:] == ["RECOGNISING", "CLAIMING", "CONFIGURING", "ACTIVE"], "no setting has changed"
        assert robot.state() == "active"

    play(tmp_path, scene)


def test_a_master_that_starts_anew_at_once_is_noticed_by_its_epoch(firmware: Firmware, tmp_path: Path) -> None:
    async def scene(robot: Robot) -> None:
        part = robot.plug(board(firmware))
        await asyncio.sleep(1)
        part.story.clear()
        await robot.kill_master()
        await robot.new_master()
        await asyncio.sleep(1)
        assert part.story == ["safe", "LOST", "RECOGNISING", "CLAIMING", "CONFIGURING", "ACTIVE"]

    play(tmp_path, scene)


def test_it_is_lost_when_it_is_pulled_and_has_its_slot_back_when_plugged_in(firmware: Firmware, tmp_path: Path) -> None:
    async def scene(robot: Robot) -> None:
        part = robot.plug(board(firmware))
        await asyncio.sleep(1)
        robot.pull(part)
        await asyncio.sleep(6.1)
        assert robot.state() == "lost"
        again = robot.plug(board(firmware, random=78), "board again")
        await asyncio.sleep(1)
        assert (again.state, robot.state()) == (PartState.ACTIVE, "active")

    play(tmp_path, scene)


def test_the_port_of_a_lost_partner_is_made_safe(firmware: Firmware, tmp_path: Path) -> None:
    async def scene(robot: Robot) -> None:
        hand = lever(robot)
        part = robot.plug(board(firmware))
        await asyncio.sleep(1)
        part.story.clear()
        hand.end()
        await asyncio.sleep(SOON_S)
        assert part.story == [f"safe {DRIVE}"]

    play(tmp_path, scene)


def test_identify_reaches_it(firmware: Firmware, tmp_path: Path) -> None:
    async def scene(robot: Robot) -> None:
        part = robot.plug(board(firmware))
        await asyncio.sleep(1)
        (client,) = [client.key for client in robot.master.agent.clients() if client.link.startswith("sim")]
        robot.master.inventory_service.identify(client)
        await asyncio.sleep(SOON_S)
        assert part.story[-1] == "identify"

    play(tmp_path, scene)


@pytest.mark.parametrize(
    ("robot", "state"),
    [
        (("PIN_ROBOT", "1", "1", "us"), PartState.ACTIVE),
        (("PIN_ROBOT", "2", "", ""), PartState.WRONG_ROBOT),
        (("", "", "", "them"), PartState.WRONG_ROBOT),
    ],
)
def test_it_says_nothing_about_itself_to_another_robot(
    firmware: Firmware, tmp_path: Path, robot: tuple[str, str, str, str], state: PartState
) -> None:
    async def scene(stage: Robot) -> None:
        part = stage.plug(board(firmware, robot=robot))
        await asyncio.sleep(12)
        assert part.state is state
        assert (stage.state() == "active") == (state is PartState.ACTIVE)

    play(tmp_path, scene)


@pytest.mark.parametrize(("explain", "state"), [(False, PartState.CLAIMING), (True, PartState.REFUSED)])
def test_a_part_that_the_robot_does_not_know_goes_on_asking(
    firmware: Firmware, tmp_path: Path, explain: bool, state: PartState
) -> None:
    async def scene(robot: Robot) -> None:
        part = robot.plug(board(firmware, part_number="NOBODY"))
        await asyncio.sleep(5)
        assert part.state is state

    head = f'[options]\nexplain = {str(explain).lower()}\n\n[[slot]]\nname = "lever"'
    play(tmp_path, scene, changes=(('[[slot]]\nname = "lever"', head),))


KEYS = (('[[slot]]\nname = "lever"', '[options]\nauthentication = "key"\n\n[[slot]]\nname = "lever"'),)


@pytest.mark.parametrize(("key", "state"), [(bytes(range(16)), "active"), (bytes(16), "refused"), (b"", "refused")])
def test_it_proves_its_key(firmware: Firmware, tmp_path: Path, key: bytes, state: str) -> None:
    async def scene(robot: Robot) -> None:
        give_key(robot, UID, bytes(range(16)))
        part = robot.plug(board(firmware, key=key))
        await asyncio.sleep(20)
        assert robot.state() == state
        assert (part.state is PartState.ACTIVE) == (state == "active")

    play(tmp_path, scene, changes=KEYS)


def test_it_is_refused_where_samples_are_sealed_and_the_journal_says_why(firmware: Firmware, tmp_path: Path) -> None:
    async def scene(robot: Robot) -> None:
        give_key(robot, UID, bytes(range(16)))
        part = robot.plug(board(firmware, key=bytes(range(16))))
        await asyncio.sleep(20)
        assert part.state is PartState.REFUSED
        assert "the part may not know how" in "\n".join(robot.master.why("PIN-BOARD"))

    play(tmp_path, scene, changes=tuple((old, new.replace('"key"', '"key+data"')) for old, new in KEYS))


def give_key(robot: Robot, uid: bytes, key: bytes) -> None:
    robot.registry.keys.store(uid, key, "test")


@given(key=st.binary(min_size=16, max_size=64), text=st.binary(max_size=200))
def test_its_hmac_is_that_of_everybody(firmware: Firmware, key: bytes, text: bytes) -> None:
    (digest,) = firmware.ask(b"M" + bytes((len(key),)) + key + text)
    assert digest == hmac.digest(key, text, hashlib.sha256)


@given(
    nonce=st.binary(min_size=16, max_size=16),
    session=st.integers(1, 2**32 - 1),
    key=st.binary(min_size=16, max_size=64),
)
def test_its_proof_is_that_of_a_part_in_python(firmware: Firmware, nonce: bytes, session: int, key: bytes) -> None:
    described = Described(uid=UID, local_name="eye", key=key)
    _, proof = firmware.ask(b"A" + described.octets(500_000), b"O" + nonce + session.to_bytes(4, "little"))
    assert proof == prove(key, nonce, UID, part_number="PIN-BOARD", local_name="eye", session_key=session)


@settings(max_examples=8, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(seed=st.integers(0, 2**32), loss=st.sampled_from((0.0, 0.01, 0.05, 0.15)), error=st.sampled_from((0.0, 1e-4)))
def test_whatever_is_lost_on_the_bus_it_comes_in_and_hears_everything_once(
    firmware: Firmware, tmp_path_factory: pytest.TempPathFactory, seed: int, loss: float, error: float
) -> None:
    """Reliable samples arrive exactly once and in order; when the bus has healed the part is active."""

    async def scene(robot: Robot) -> None:
        bus = robot.driver.bus
        part = robot.plug(board(firmware))
        hand = lever(robot)
        nodes = [robot.nodes[name] for name in ("board", "master")]
        for node in nodes:
            bus.deafen(node, probability=loss)
        bus.set_bit_error_rate(error)
        await asyncio.sleep(20)
        for node in nodes:
            bus.deafen(node)
        bus.set_bit_error_rate(0)
        await asyncio.sleep(15)
        assert robot.state() == "active"
        part.heard.clear()
        for on in (True, False, False, True):
            hand.publish("on", Switch(on=on))
        await asyncio.sleep(1)
        assert part.heard == [(DRIVE, ON), (DRIVE, OFF), (DRIVE, OFF), (DRIVE, ON)]

    play(tmp_path_factory.mktemp("robot"), scene, seed=seed)


@given(data=st.data())
def test_arbitrary_packets_in_its_session_do_no_harm(firmware: Firmware, data: st.DataObject) -> None:
    """The sanitizers watch; octets that look like submessages get deep."""
    described = Described(uid=UID)
    login = bytes.fromhex("81000000 04010b00 00005852 43450100 010f00")
    joined = (0x0200_0000 | 2 << 8 | 5).to_bytes(4, "little") + b"\1" + UID
    requests = [
        b"A" + described.octets(500_000),
        b"B",
        b"N\0" + bytes(4),
        b"F" + bytes(4) + joined,
        b"V" + bytes(4) + login,
    ]
    submessage = st.builds(
        lambda kind, flags, wrong, body: (
            bytes((kind, flags)) + (len(body) + wrong).to_bytes(2, "little") + body + bytes(-len(body) & 3)
        ),
        st.sampled_from((2, 4, 5, 6, 9, 9, 9, 10, 11, 13)),
        st.sampled_from((1, 1, 1, 3, 0)),
        st.sampled_from((0, 0, 0, 1, 4)),
        st.builds(
            bytes.__add__,
            st.sampled_from((b"", bytes.fromhex("c0160016"), bytes.fromhex("c017001780050017"))),
            st.binary(max_size=60)
            | st.sampled_from((4, 8, 12, 16)).flatmap(lambda n: st.binary(min_size=n, max_size=n)),
        ),
    )
    for number in range(data.draw(st.integers(0, 8))):
        stream = data.draw(st.sampled_from((0, 1, 0x80, 0x80)))
        sequence = data.draw(st.sampled_from((number, number, 0, 16, 65535)))
        packet = bytes((0x81, stream)) + sequence.to_bytes(2, "little")
        packet += b"".join(data.draw(st.lists(submessage, max_size=4)))
        requests.append(b"V" + (number * 1000).to_bytes(4, "little") + packet)
        requests += [b"N\0" + (number * 1000).to_bytes(4, "little")] * 3
    firmware.ask(*requests, b"T" + (60_000_000).to_bytes(4, "little"), b"I")
