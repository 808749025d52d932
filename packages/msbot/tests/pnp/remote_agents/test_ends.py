"""The gate of an agent and the master that feeds it, over a way that loses, doubles and cuts; whatever comes."""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import pairwise
from random import Random

from hypothesis import given
from hypothesis import strategies as st

from msbot.config import PartType, Slot
from msbot.part.join import pnp_messages
from msbot.pnp import Claim, Configuration, Inventory, MemoryStore, Profile, RobotGate, SlotBinding
from msbot.pnp.model import LifeTiming
from msbot.pnp.remote_agents.agent_messages import (
    AgentHello,
    Ask,
    FromAgent,
    FromMaster,
    OpenTopic,
    decode_from_agent,
    encode,
)
from msbot.pnp.remote_agents.master_side import MasterSide
from msbot.pnp.remote_agents.remote_gate import BEAT_S, SILENT_S, RemoteGate
from msbot_agent.agent import ClientInfo

AGENT = 0xA6E47
SLOTS = tuple(Slot(f"slot{number}", "PART") for number in range(4))
TIMING = LifeTiming(beat_s=60.0, tick_s=60.0)  # no part is lost for its beats here


def sample_slots() -> MemoryStore:
    """A robot of four slots, each with a port that publishes."""
    return MemoryStore(
        types=(PartType("PART", "a part"),),
        slots=SLOTS,
        configurations=tuple(
            Configuration(1, slot.name, (SlotBinding("port", f"{slot.name}_topic", "Level", publishes=True),))
            for slot in SLOTS
        ),
    )


@dataclass
class Scene:
    """Both ends, and the way between them."""

    random: Random
    drop: float = 0.0
    twice: float = 0.0
    now: float = 100.0
    to_master: list[bytes] = field(default_factory=list)
    to_agent: list[bytes] = field(default_factory=list)
    asked: list[tuple[int, bytes]] = field(default_factory=list)
    orders: list[tuple[pnp_messages.NoticeKind, int]] = field(default_factory=list)
    stops: list[str] = field(default_factory=list)
    stop: tuple[int, bool] = (0, False)
    said: list[str] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.inventory = Inventory(sample_slots(), random=Random(1), now=self.now, timing=TIMING)
        self.access = RobotGate(self.inventory, clock=lambda: self.now)
        self.master = MasterSide(self.access, self.inventory, Profile(), MasterAround(self), random=Random(2))
        self.access.use_agents(self.master, lambda _: None)
        self.agent = RemoteGate(boot=7, name="pi", around=AgentAround(self), clock=lambda: self.now)
        self.agent.start(self.now)
        self.clients: dict[int, ClientInfo] = {}

    def carried(self, way: list[bytes], octets: bytes) -> None:
        """Put it on the way, once, twice, or not at all."""
        for _ in range(1 + (self.random.random() < self.twice)):
            if self.random.random() >= self.drop:
                way.append(octets)

    def settle(self) -> None:
        """Deliver what is on the way, and what that causes."""
        while self.to_master or self.to_agent:
            up, self.to_master = self.to_master, []
            for octets in up:
                self.master.receive(AGENT, decode_from_agent(octets), self.now)
            down, self.to_agent = self.to_agent, []
            for octets in down:
                self.agent.receive(octets, self.now)

    def live(self, seconds: float) -> None:
        """Let time pass."""
        end = self.now + seconds
        while self.now < end:
            self.now = min(end, self.now + BEAT_S / 2)
            self.agent.handle_timer(self.now)
            self.master.handle_timer(self.now)
            self.settle()

    def open(self, number: int) -> None:
        """A client opens a session, or opens it again."""
        info = ClientInfo(number + 1, "can:can0", number, f"CAN node {number}")
        if self.agent.may_join(info):
            self.clients[number] = info
            self.agent.joined(info)
            self.agent.may_read(info, pnp_messages.PROFILE_TOPIC)
            self.settle()

    def close(self, number: int) -> None:
        """Its session ends."""
        if (info := self.clients.pop(number, None)) is not None:
            self.agent.session_ended(info, "session deleted")
            self.settle()

    def claim(self, number: int) -> None:
        """It asks for its place; the inventory decides as soon as it hears it."""
        self.asked.clear()
        self.agent.ask(number + 1, in_compat=False, identity=bytes(24), body=bytes((number,)))
        self.settle()
        for key, body in self.asked:
            uid = bytes((*b"a part ", body[0]))
            self.inventory.claim(Claim("PART", f"slot{body[0]}", uid), key, self.now)
        self.settle()

    def rights_here(self) -> dict[int, set[tuple[str, bool]]]:
        """What the agent lets each client do."""
        topics = {f"{slot.name}_topic" for slot in SLOTS}
        return {
            number: {
                (topic, way)
                for topic in topics
                for way, may in ((True, self.agent.may_write), (False, self.agent.may_read))
                if may(info, topic)
            }
            for number, info in self.clients.items()
        }

    def rights_there(self) -> dict[int, set[tuple[str, bool]]]:
        """What the inventory has decided for each client."""
        found: dict[int, set[tuple[str, bool]]] = {}
        for info in self.inventory.view(self.now):
            if not info.state.is_over and self.master.has(info.client_key):
                configuration = self.inventory.configuration_of(info.client_key)
                bindings = () if configuration is None else configuration.bindings
                number = int(info.address.split()[2])
                found[number] = {(binding.topic, binding.publishes) for binding in bindings}
        return found


class AgentAround:
    """The agent around its end."""

    def __init__(self, scene: Scene) -> None:
        self.scene = scene

    def send(self, message: FromAgent) -> None:
        self.scene.carried(self.scene.to_master, encode(message))

    def order(self, kind: pnp_messages.NoticeKind, number: int) -> None:
        self.scene.orders.append((kind, number))

    def heard_at(self, client_key: int) -> float | None:
        return self.scene.now

    def say(self, words: str) -> None:
        self.scene.said.append(words)

    def rights_changed(self, client_key: int) -> None: ...
    def topics_changed(self) -> None: ...
    def answer(self, in_compat: bool, identity: bytes, body: bytes) -> None: ...
    def welcome(self, profile: Profile) -> None: ...
    def session_ended(self, client_key: int) -> None: ...
    def close(self, client_key: int, reason: str) -> None: ...
    def probe(self, client_key: int) -> None: ...


class MasterAround:
    """The master around its end."""

    def __init__(self, scene: Scene) -> None:
        self.scene = scene

    def send(self, agent: int, message: FromMaster) -> None:
        assert agent == AGENT
        self.scene.carried(self.scene.to_agent, encode(message))

    def ask(self, key: int, in_compat: bool, identity: bytes, body: bytes) -> None:
        self.scene.asked.append((key, body))

    def stop_said(self, agent: str, words: str) -> None:
        self.scene.stops.append(f"{agent}: {words}")

    def stop_number(self) -> tuple[int, bool]:
        return self.scene.stop

    def recheck(self, agent: int) -> None: ...
    def say(self, words: str) -> None: ...


DONE = st.one_of(
    st.tuples(st.sampled_from(["open", "close", "claim"]), st.integers(0, 3)),
    st.tuples(st.just("live"), st.sampled_from([0.3, 1.1, 2.6])),
    st.tuples(st.just("drop"), st.sampled_from([0.0, 0.3, 1.0])),
    st.tuples(st.just("stop"), st.booleans()),
    st.tuples(st.just("press"), st.just(0)),
)


def act(scene: Scene, what: str, value: float) -> None:
    match what:
        case "live":
            scene.live(value)
        case "drop":
            scene.drop = value
        case "stop":
            number, holds = scene.stop
            scene.stop = (number + bool(value and not holds), bool(value))
            scene.master.tell_stop()
            scene.settle()
        case "press":
            scene.agent.stop_said("STOP was pressed")
            scene.settle()
        case _:
            getattr(scene, what)(int(value))


def test_a_verdict_that_was_lost_on_the_way_is_said_again() -> None:
    scene = Scene(Random(1))
    scene.live(1.0)
    scene.open(1)
    scene.agent.ask(2, in_compat=False, identity=bytes(24), body=b"1")
    scene.settle()
    scene.drop = 1.0
    scene.inventory.claim(Claim("PART", "slot1", b"a part 1"), scene.asked[0][0], scene.now)
    scene.drop = 0.0
    assert scene.rights_here() == {1: set()}
    scene.live(1.0)
    assert scene.rights_here() == scene.rights_there() == {1: {("slot1_topic", True)}}


def test_a_stop_is_told_although_the_go_before_it_was_lost() -> None:
    scene = Scene(Random(1))
    scene.live(1.0)
    act(scene, "stop", True)
    scene.drop = 1.0
    act(scene, "stop", False)
    scene.drop = 0.0
    act(scene, "stop", True)
    assert scene.orders == [(pnp_messages.NoticeKind.STOP, 1), (pnp_messages.NoticeKind.STOP, 2)]
    act(scene, "stop", False)
    assert scene.orders[2:] == [(pnp_messages.NoticeKind.GO, 2)]


def test_one_press_is_one_stop_also_when_the_agent_was_silent_before_it_knew() -> None:
    scene = Scene(Random(1))
    scene.live(1.0)
    scene.agent.stop_said("STOP was pressed")
    scene.to_agent.clear()
    up, scene.to_master = scene.to_master, []
    scene.drop = 1.0
    for octets in up:
        scene.master.receive(AGENT, decode_from_agent(octets), scene.now)
    assert scene.stops == ["pi: STOP was pressed"]
    scene.live(5.0)
    assert scene.master.names() == [("pi", 0, True)]
    scene.drop = 0.0
    scene.live(2.0)
    assert scene.master.names() == [("pi", 0, False)]
    assert scene.stops == ["pi: STOP was pressed"]
    act(scene, "press", 0)
    assert scene.stops == ["pi: STOP was pressed"] * 2


@given(st.lists(DONE, max_size=16), st.randoms(use_true_random=False), st.sampled_from([0.0, 0.3]))
def test_whatever_happened_both_ends_agree_once_the_way_is_whole(
    story: list[tuple[str, float]], random: Random, twice: float
) -> None:
    scene = Scene(random, twice=twice)
    scene.live(1.0)
    presses = 0
    for what, value in story:
        presses += what == "press"
        before = scene.rights_here()
        was_deaf = scene.drop == 1.0
        act(scene, what, value)
        if was_deaf and what != "drop":  # cut off: verdicts stay, and nobody gets more
            for number, rights in scene.rights_here().items():
                assert rights == before.get(number, set()) or (what == "open" and not rights)
    scene.drop = 0.0
    scene.live(5.0)
    assert scene.rights_here() == scene.rights_there()
    told = [kind for kind, _ in scene.orders]
    # Of a STOP whose GO was lost on the way the next STOP is told all the same; a GO ends what was told.
    before_each = [pnp_messages.NoticeKind.GO, *told]
    assert all(
        now is pnp_messages.NoticeKind.STOP or last is pnp_messages.NoticeKind.STOP
        for last, now in pairwise(before_each)
    )
    numbers = [number for kind, number in scene.orders if kind is pnp_messages.NoticeKind.STOP]
    assert numbers == sorted(set(numbers)), "each STOP once, in their order"
    assert (bool(told) and told[-1] is pnp_messages.NoticeKind.STOP) is scene.stop[1]
    assert bool(scene.stops) is bool(presses)
    assert len(scene.stops) <= presses
    for number in list(scene.clients):
        scene.close(number)
    scene.live(2.0)
    assert scene.rights_there() == {}
    assert scene.master.names() == [("pi", 0, False)]


@given(st.binary(max_size=60), st.integers(0, 40))
def test_any_octets_are_read_or_counted(octets: bytes, kind: int) -> None:
    scene = Scene(Random(1))
    scene.live(1.0)
    scene.agent.receive(bytes((kind,)) + octets, scene.now)
    scene.agent.receive(octets, scene.now)
    scene.live(4.0)
    assert scene.agent.is_welcome


def test_without_a_master_nobody_is_let_in_and_what_is_cut_off_is_said_once() -> None:
    scene = Scene(Random(1), drop=1.0)
    scene.live(3.0)
    scene.open(1)
    assert not scene.clients
    scene.drop = 0.0
    scene.live(1.0)
    scene.open(1)
    scene.claim(1)
    assert scene.rights_here() == {1: {("slot1_topic", True)}}
    scene.drop = 1.0
    scene.live(3 * SILENT_S)
    scene.open(2)
    assert scene.rights_here() == {1: {("slot1_topic", True)}}
    assert [words.split(":")[0] for words in scene.said] == ["the master is silent"]
    assert {info.state.value for info in scene.inventory.view(scene.now)} == {"lost"}


def test_an_agent_speaks_only_for_its_own_sessions_and_may_use_only_their_topics() -> None:
    scene = Scene(Random(1))
    scene.live(1.0)
    scene.open(0)
    scene.claim(0)
    assert scene.master.may(AGENT, "slot0_topic", publishes=True)
    assert not scene.master.may(AGENT, "slot0_topic", publishes=False)
    assert not scene.master.may(AGENT, "slot1_topic", publishes=True)
    assert not scene.master.may(AGENT + 1, "slot0_topic", publishes=True)
    scene.close(0)
    assert not scene.master.may(AGENT, "slot0_topic", publishes=True)
    # A number that it never said is nobody's.
    scene.master.receive(AGENT, Ask(number=99, compat=0, identity=bytes(24), body=b"1234"), scene.now)
    assert scene.master.dropped == {"message about an unknown session of an agent": 1}


def test_a_second_agent_of_that_name_is_told_so_until_the_first_is_silent() -> None:
    scene = Scene(Random(1))
    scene.live(1.0)
    told: list[FromMaster] = []
    scene.master._around.send = lambda agent, message: told.append(message)  # type: ignore[method-assign]
    scene.master.receive(AGENT + 1, AgentHello(boot=8, name="pi"), scene.now)
    assert "give this one another with --name" in str(told[-1])
    scene.now += 3
    scene.master.handle_timer(scene.now)
    scene.master.receive(AGENT + 1, AgentHello(boot=8, name="pi"), scene.now)
    assert scene.master.knows(AGENT + 1)
    assert not scene.master.knows(AGENT)


def test_what_may_be_open_survives_the_wire() -> None:
    topic = OpenTopic(topic="light", topic_type="Light", publishes=1, reliable=0)
    assert OpenTopic.decode(topic.encode()) == topic
