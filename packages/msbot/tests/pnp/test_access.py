"""Who may use which topic (R45, R48, R52, R57)."""

from __future__ import annotations

from dataclasses import replace

import pytest

from msbot.part.join import pnp_messages, thesis_messages
from msbot.pnp import PROFILE_TOPIC, Configuration, PartState, SlotBinding
from msbot.pnp.robot_gate import (
    INVENTORY_REPLY_TOPIC,
    INVENTORY_REQUEST_TOPIC,
    INVENTORY_SERVICE,
    RESERVED_TOPICS,
    RobotGate,
)
from msbot_agent.agent.gate import ClientInfo, Gate
from msbot_agent.link import ConnectionUser
from msbot_agent.link.net.websocket_server import SocketPeer, WebSocketServerLink
from tests.pnp.robot import Rig, sample_store

KEY = 0xAAAAAAAA
PART = ClientInfo(KEY, "sim:500000", 7, "CAN node 7")
SERVICE = ClientInfo(0xCDCDCDCD, "inproc", 1, "in-process client 1")
RING_TOPICS = [f"HelloWorldTopic_{pair}" for pair in ("1_to_2", "2_to_3", "3_to_1")]
REQUESTS = [INVENTORY_REQUEST_TOPIC, thesis_messages.REQUEST_TOPIC]
REPLIES = [INVENTORY_REPLY_TOPIC, thesis_messages.REPLY_TOPIC]


class Door:
    """A rig with the gate in front of it, and what an agent would have been told to recheck."""

    def __init__(self, *free: str) -> None:
        self.rig = Rig(sample_store())
        self.access = RobotGate(self.rig.inventory, clock=lambda: self.rig.now, free_topics=frozenset(free))
        self.rechecked: list[int] = []
        self.rig.inventory.on_rights(self.rechecked.append)

    def let_in(self, client: ClientInfo = PART, number: str = "ABCD") -> None:
        assert self.access.may_join(client)
        self.access.joined(client)
        self.rig._open.add(client.key)
        self.rig.claim(client.key, number)

    def open_to(self, client: ClientInfo, topics: list[str]) -> list[str]:
        """`w` and `r` for each topic the client may write and read."""
        return [
            "w" * self.access.may_write(client, topic) + "r" * self.access.may_read(client, topic) for topic in topics
        ]


def test_access_has_the_shape_of_the_agents_gate() -> None:
    gate: Gate = Door().access
    assert gate.may_join(PART)


def test_names_are_those_that_parts_use() -> None:
    assert INVENTORY_SERVICE == pnp_messages.INVENTORY_SERVICE
    assert (INVENTORY_REQUEST_TOPIC, INVENTORY_REPLY_TOPIC) == (
        pnp_messages.INVENTORY_REQUEST_TOPIC,
        pnp_messages.INVENTORY_REPLY_TOPIC,
    )


def test_before_both_steps_are_done_only_the_profile_and_the_inventory_are_open() -> None:
    door = Door()
    door.access.joined(PART)
    assert door.open_to(PART, [PROFILE_TOPIC, *REQUESTS, *REPLIES]) == ["r", "w", "w", "", ""]
    assert door.open_to(PART, [*RING_TOPICS, "anything"]) == ["", "", "", ""]


def test_an_active_part_may_use_its_slots_topics_by_direction_and_nothing_else() -> None:
    door = Door()
    door.let_in()
    assert door.open_to(PART, RING_TOPICS) == ["w", "", "r"]
    assert door.open_to(PART, ["anything"]) == [""]
    assert door.rechecked == [KEY]


def test_a_refused_part_gets_nothing() -> None:
    door = Door()
    door.let_in(number="NOPE")
    assert door.open_to(PART, RING_TOPICS) == ["", "", ""]
    assert door.rechecked == []


def test_after_delisting_the_topics_are_closed_and_the_agent_is_told_within_the_tick() -> None:
    door = Door()
    door.let_in()
    door.rig.run(6.0)
    assert door.rig.events[-1].to_state is PartState.LOST
    assert door.open_to(PART, RING_TOPICS) == ["", "", ""]
    assert door.open_to(PART, [PROFILE_TOPIC, *REQUESTS]) == ["r", "w", "w"]
    assert door.rechecked == [KEY, KEY]


def test_logging_in_again_voids_all_rights_until_the_next_claim() -> None:
    door = Door()
    door.let_in()
    door.access.joined(replace(PART, address="elsewhere"))
    assert door.open_to(PART, RING_TOPICS) == ["", "", ""]
    door.rig.claim(KEY, "ABCD")
    assert door.open_to(PART, RING_TOPICS) == ["w", "", "r"]


def test_a_session_replaced_by_its_own_client_keeps_its_slot() -> None:
    door = Door()
    door.let_in()
    door.access.session_ended(PART, "replaced by a new session of the same key")
    door.access.joined(PART)
    assert door.rig.changes(KEY) == ["new", "checking", "active", "checking"]
    assert door.open_to(PART, RING_TOPICS) == ["", "", ""]


@pytest.mark.parametrize(
    ("reason", "state"), [("session deleted", PartState.LEFT), ("silent", PartState.LOST), ("gone: x", PartState.LOST)]
)
def test_goodbye_is_told_from_vanishing(reason: str, state: PartState) -> None:
    door = Door()
    door.let_in()
    door.access.session_ended(PART, reason)
    assert (door.rig.events[-1].to_state, door.rig.events[-1].reason) == (state, reason)
    assert door.open_to(PART, RING_TOPICS) == ["", "", ""]


def test_nobody_but_the_trusted_master_may_publish_the_profile_or_answer_requests() -> None:
    door = Door(*RESERVED_TOPICS)
    door.rig.store.configurations["AA"] = Configuration(
        1,
        "AA",
        tuple(SlotBinding("p", topic, "t", publishes=flag) for topic in RESERVED_TOPICS for flag in (True, False)),
    )
    door.let_in()
    assert door.open_to(PART, [PROFILE_TOPIC, *REQUESTS, *REPLIES]) == ["r", "w", "w", "", ""]
    assert door.open_to(SERVICE, [PROFILE_TOPIC, *REQUESTS, *REPLIES, "x"]) == ["wr"] * 6


def test_asking_for_the_profile_begins_step_1() -> None:
    door = Door()
    door.access.joined(PART)
    assert door.rig.state(KEY) is PartState.NEW
    door.access.may_read(PART, PROFILE_TOPIC)
    assert door.rig.state(KEY) is PartState.CHECKING


def test_the_robots_own_services_are_not_shown_as_parts() -> None:
    door = Door()
    door.access.joined(SERVICE)
    door.access.session_ended(SERVICE, "session deleted")
    assert door.rig.inventory.view(door.rig.now) == []


def test_a_key_that_is_in_use_on_one_link_opens_nothing_on_another() -> None:
    door = Door()
    door.access.joined(SERVICE)
    door.let_in()
    assert not door.access.may_join(replace(SERVICE, link="udp:0.0.0.0:8888"))
    assert not door.access.may_join(replace(PART, link="udp:0.0.0.0:8888"))
    assert door.access.may_join(replace(PART, peer=8, address="CAN node 8"))
    assert door.access.denied == {"client key in use on another link": 2}
    door.access.session_ended(PART, "silent")
    assert door.access.may_join(replace(PART, link="udp:0.0.0.0:8888"))


def test_nobody_can_keep_the_robots_own_services_out() -> None:
    door = Door()
    door.access.joined(replace(SERVICE, link="udp:0.0.0.0:8888"))
    assert door.access.may_join(SERVICE)


def test_free_topics_are_open_to_everybody() -> None:
    door = Door("weather")
    door.access.joined(PART)
    assert door.open_to(PART, ["weather"]) == ["wr"]


def test_the_way_to_active_is_measured_from_the_moment_the_link_saw_the_peer() -> None:
    door = Door()
    door.access.peer_joined(PART.link, PART.peer, door.rig.now)
    door.rig.now += 0.25
    door.let_in()
    assert door.rig.part(KEY).plug_in_to_active_ms == 250.0
    door.rig.now += 5.0
    door.let_in()
    assert door.rig.part(KEY).plug_in_to_active_ms == 0.0


def test_peers_that_never_log_in_are_forgotten() -> None:
    door = Door()
    for peer in range(2000):
        door.access.peer_joined(PART.link, peer, door.rig.now)
    assert len(door.access._plugs) == 1024


def test_a_part_that_sends_too_much_is_limited_each_time_and_journaled_once_a_minute() -> None:
    door = Door()
    door.let_in()

    def told() -> list[str]:
        return [event.reason for event in door.rig.events if event.reason.startswith("sends ")]

    words = "sends 1234 packets a second, more than its share of 50: the rest is not read"
    for later, times in ((0.0, 1), (0.1, 1), (59.8, 1), (0.2, 2), (59.9, 2)):
        door.rig.now += later
        assert door.access.limits(PART, 1234.4, 50.2)
        assert told() == [words] * times
    assert not door.access.limits(SERVICE, 1e6, 1.0)
    assert told() == [words] * 2


class Agents:
    """Two agents elsewhere; one has a part that writes a topic."""

    def knows(self, agent: int) -> bool:
        return agent in (0xA1, 0xA2)

    def may(self, agent: int, topic: str, *, publishes: bool) -> bool:
        return (agent, topic, publishes) == (0xA1, "far", True)

    def agent_of(self, key: int) -> int | None:
        return None


def test_an_agent_may_what_its_parts_may_and_every_end_is_told() -> None:
    door = Door("free")
    left: list[int] = []
    door.access.use_agents(Agents(), left.append)
    clients = [ClientInfo(key, "udp", key, f"peer {key}") for key in (0xA1, 0xA2, 0xA3)]
    for client in clients:
        door.access.joined(client)
    topics = ["far", "free", "HelloWorldTopic_1_to_2", *REQUESTS, *REPLIES]
    asks = ["w", "w", "", ""]
    assert [door.open_to(client, topics) for client in clients] == [
        ["w", "wr", "", *asks],
        ["", "wr", "", *asks],
        ["", "wr", "", *asks],
    ]
    for client, reason in zip(clients, ("session deleted", "silent", "replaced by itself"), strict=True):
        door.access.session_ended(client, reason)
    assert left == [0xA1, 0xA2]


def test_who_cannot_be_displaced_by_strangers() -> None:
    door = Door()
    assert door.access.limits_strangers()
    assert door.access.keeps(PART) is True
    door.access.joined(PART)
    agent = ClientInfo(0xA1, "sim:500000", 8, "CAN node 8")

    def settled() -> list[bool]:
        return [door.access.is_settled(one) is True for one in (PART, SERVICE, agent)]

    assert settled() == [False, True, False]
    door.access.use_agents(Agents(), lambda _: None)
    assert settled() == [False, True, True]
    door.let_in()
    assert settled() == [True, True, True]


def test_a_flood_is_noted_once_a_minute_and_anew_for_who_comes_back() -> None:
    door = Door()
    door.let_in()
    door.rig.events.clear()
    noted: list[float] = []
    for at in (100.0, 130.0, 159.9, 160.0, 200.0, 219.9, 230.0):
        door.rig.now = at
        assert door.access.limits(PART, 1234.5, 99.6)
        assert not door.access.limits(SERVICE, 1e6, 1.0)
        noted += [event.at for event in door.rig.events if event.reason.startswith("sends ")]
        assert all(
            event.reason.startswith("sends 1234 packets a second, more than its share of 100: ")
            for event in door.rig.events
        )
        door.rig.events.clear()
        if at == 200.0:
            door.access.session_ended(PART, "silent")
            door.let_in()
            door.rig.events.clear()
    assert noted == [100.0, 160.0, 219.9]


@pytest.mark.parametrize("is_pupil", [True, False])
def test_whose_browser_a_part_runs_in_is_known_of_pupils_alone(is_pupil: bool) -> None:
    door = Door()
    visitor = ConnectionUser("ada", "192.168.1.30", "ada" if is_pupil else "")
    door.access.joined(
        ClientInfo(7, "ws:", SocketPeer(WebSocketServerLink("ws:"), visitor, 0.0), "ada at 192.168.1.30")
    )
    door.access.joined(PART)
    assert door.rig.inventory.pupil_parts.here() == ({"ada": ()} if is_pupil else {})
