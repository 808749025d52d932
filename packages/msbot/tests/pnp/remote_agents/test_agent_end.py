"""The gate of an agent: its beats, what it passes on and what it repeats, one message at a time."""

from __future__ import annotations

import math
from typing import Any

import pytest

from msbot.part.calls import ReplyStatus, encode_reply
from msbot.part.join import pnp_messages
from msbot.pnp import Profile
from msbot.pnp.remote_agents.agent_messages import (
    AgentBeat,
    AgentHello,
    AgentRefused,
    AgentWelcome,
    Answer,
    Ask,
    Close,
    Forgotten,
    FromAgent,
    FromMaster,
    Held,
    MasterHeard,
    OpenTopic,
    Remark,
    Rights,
    SessionOpen,
    SessionOver,
    Sign,
    Sought,
    WhoIsThat,
    encode,
)
from msbot.pnp.remote_agents.remote_gate import (
    BEAT_S,
    FLOOD_TOLD_S,
    MOST_ENDED,
    REFUSED_AGAIN_S,
    REPEATED_PER_BEAT,
    SILENT_S,
    RemoteGate,
)
from msbot_agent.agent import ClientInfo

BOOT = 7
LIGHT = OpenTopic(topic="light", topic_type="Light", publishes=1, reliable=0)


class Around:
    """The agent: keeps what is done to it."""

    def __init__(self) -> None:
        self.sent: list[FromAgent] = []
        self.done: list[tuple[Any, ...]] = []
        self.heard: dict[int, float] = {}

    def send(self, message: FromAgent) -> None:
        self.sent.append(message)

    def heard_at(self, client_key: int) -> float | None:
        return self.heard.get(client_key)

    def __getattr__(self, name: str) -> Any:
        return lambda *values: self.done.append((name, *values))


class Gate:
    """A gate at its agent, and its time."""

    def __init__(self) -> None:
        self.now = 100.0
        self.around = Around()
        self.end = RemoteGate(boot=BOOT, name="pi", around=self.around, clock=lambda: self.now)

    def sent(self) -> list[FromAgent]:
        """What it has said since the last time."""
        sent, self.around.sent = self.around.sent, []
        return sent

    def done(self) -> list[tuple[Any, ...]]:
        """What it has done to its agent since the last time."""
        done, self.around.done = self.around.done, []
        return done

    def hear(self, *messages: FromMaster) -> None:
        """The master speaks."""
        for message in messages:
            self.end.receive(encode(message), self.now)

    def beat(self) -> list[FromAgent]:
        """Its next beat, and what it says with it."""
        self.sent()
        self.now = self.end.timer()
        self.end.handle_timer(self.now)
        return self.sent()


def welcome(boot: int = BOOT) -> AgentWelcome:
    return AgentWelcome(boot=boot, robot="Max", version="1", serial_number="2", released="3", manufacturer="4")


def part(key: int, number: int = 1) -> ClientInfo:
    return ClientInfo(key, "can:can0", number, f"CAN node {number}", shown_key=0xC0 + key)


def heard(count: int = 0, stop: int = 0, *, holds: bool = False, stops_confirmed: int = 0) -> MasterHeard:
    return MasterHeard(count=count, stop=stop, holds=int(holds), stops_confirmed=stops_confirmed)


def rights(number: int, *topics: OpenTopic, times: int = 1, settled: int = 1, reads_profile: int = 0) -> Rights:
    return Rights(number=number, times=times, reads_profile=reads_profile, settled=settled, topics=list(topics))


@pytest.fixture
def gate() -> Gate:
    return Gate()


@pytest.fixture
def fed(gate: Gate) -> Gate:
    """A gate that its master has taken."""
    gate.end.start(gate.now)
    gate.hear(welcome())
    gate.sent()
    gate.done()
    return gate


def test_it_says_who_it_is_with_every_beat_until_it_is_welcome(gate: Gate) -> None:
    assert gate.end.timer() == math.inf
    gate.end.start(gate.now)
    assert gate.end.timer() == 100.0
    gate.end.handle_timer(99.9)
    assert not gate.sent()
    hello = AgentHello(boot=BOOT, name="pi")
    assert gate.beat() == [hello, AgentBeat(count=1, stops_said=0, words="")]
    assert gate.end.timer() == 100.0 + BEAT_S
    assert gate.beat() == [hello, AgentBeat(count=2, stops_said=0, words="")]
    gate.hear(welcome(boot=BOOT + 1))
    assert not gate.end.is_welcome
    gate.hear(welcome())
    assert gate.done() == [("welcome", Profile("Max", "1", "2", "3", "4"))]
    assert gate.beat() == [AgentBeat(count=3, stops_said=0, words="")]
    gate.hear(welcome())
    assert not gate.done()


def test_sessions_and_their_ends_are_repeated_until_the_master_has_heard_of_them(fed: Gate) -> None:
    fed.end.joined(part(5))
    opened = SessionOpen(number=1, times=1, client_key=0xC5, reads_profile=0, address="CAN node 1")
    assert fed.sent() == [opened]
    assert opened in fed.beat()
    assert fed.end.may_read(part(5), pnp_messages.PROFILE_TOPIC)
    assert fed.end.may_read(part(5), pnp_messages.PROFILE_TOPIC)
    (read,) = fed.sent()
    assert isinstance(read, SessionOpen)
    assert read.reads_profile
    fed.hear(rights(1, settled=0))  # an answer to the first
    assert read in fed.beat()
    fed.hear(rights(1, settled=0, reads_profile=1))
    assert [type(one) for one in fed.beat()] == [AgentBeat]
    fed.end.joined(part(5))
    assert fed.sent() == [SessionOpen(number=1, times=2, client_key=0xC5, reads_profile=0, address="CAN node 1")]
    fed.end.session_ended(part(5), "session deleted")
    over = SessionOver(number=1, reason="session deleted")
    assert fed.sent() == [over]
    assert fed.done() == [("session_ended", 5)]
    assert over in fed.beat()
    fed.hear(Forgotten(number=1))
    assert [type(one) for one in fed.beat()] == [AgentBeat]
    fed.end.joined(part(5))
    assert [one.number for one in fed.sent() if isinstance(one, SessionOpen)] == [2]  # a number is never used again


def test_with_one_beat_only_so_many_are_repeated(fed: Gate) -> None:
    for key in range(1, REPEATED_PER_BEAT + 3):
        fed.end.joined(part(key))
    assert sum(isinstance(one, SessionOpen) for one in fed.beat()) == REPEATED_PER_BEAT
    for key in range(1, REPEATED_PER_BEAT + 3):
        fed.end.session_ended(part(key), "gone")
    assert sum(isinstance(one, SessionOver) for one in fed.beat()) == REPEATED_PER_BEAT


def test_of_too_many_ends_the_oldest_is_not_repeated(fed: Gate) -> None:
    for key in range(1, MOST_ENDED + 2):
        fed.end.joined(part(key))
        fed.end.session_ended(part(key), "gone")
    overs = [one.number for one in fed.beat() if isinstance(one, SessionOver)]
    assert overs[0] == 2
    fed.hear(*(Forgotten(number=number) for number in range(1, MOST_ENDED + 1)))
    assert [one.number for one in fed.beat() if isinstance(one, SessionOver)] == [MOST_ENDED + 1]


def test_who_opens_its_session_again_is_not_gone_and_has_no_rights_until_they_are_said(fed: Gate) -> None:
    fed.end.joined(part(5))
    fed.hear(rights(1, LIGHT))
    assert fed.done() == [("topics_changed",), ("rights_changed", 5)]
    assert fed.end.is_settled(part(5))
    assert fed.end.may_write(part(5), "light")
    assert not fed.end.may_read(part(5), "light")
    assert list(fed.end.topics()) == [LIGHT]
    fed.hear(rights(1, LIGHT))
    assert not fed.done()  # nothing new
    fed.end.session_ended(part(5), "replaced by a new session of the same client")
    assert fed.end.is_settled(part(5))
    fed.end.joined(part(5))
    assert fed.done() == [("topics_changed",)]
    assert not fed.end.is_settled(part(5))
    assert not fed.end.may_write(part(5), "light")
    assert not list(fed.end.topics())
    fed.hear(rights(1, LIGHT))  # of the session before
    assert not fed.end.is_settled(part(5))
    fed.hear(rights(1, LIGHT, times=2))
    assert fed.end.is_settled(part(5))


def test_what_a_part_asks_is_passed_on_while_a_master_is_heard(gate: Gate) -> None:
    identity = bytes(range(24))
    gate.end.ask(5, in_compat=False, identity=identity, body=b"1234")
    assert gate.end.dropped == {"request without a session": 1}
    gate.end.joined(part(5))
    gate.sent()
    gate.end.ask(5, in_compat=False, identity=identity, body=b"1234")
    assert gate.end.dropped == {"request without a session": 1, "request while no master is heard": 1}
    assert not gate.sent()
    gate.hear(welcome())
    gate.sent()
    for compat in (False, True):
        gate.end.ask(5, in_compat=compat, identity=identity, body=b"1234")
        assert gate.sent() == [Ask(number=1, compat=int(compat), identity=identity, body=b"1234")]
    gate.end.lost_master()
    gate.end.ask(5, in_compat=False, identity=identity, body=b"1234")
    assert gate.end.dropped["request while no master is heard"] == 2
    gate.done()
    gate.hear(Answer(number=9, compat=0, identity=identity, body=b"5"))  # for nobody
    assert not gate.done()
    gate.hear(Answer(number=1, compat=1, identity=identity, body=b"5"))
    assert gate.done() == [("answer", True, identity, b"5")]


def test_the_master_is_silent_after_two_seconds_and_heard_again(fed: Gate) -> None:
    fed.end.joined(part(5))
    fed.hear(rights(1, LIGHT))
    fed.done()
    began = fed.now
    while fed.now < began + SILENT_S:
        fed.beat()
        assert not fed.end.is_cut_off
    fed.beat()
    words = "the master is silent: 1 part that is in stay as they are, and nobody new is let in until it is back"
    assert fed.done() == [("say", words)]
    assert fed.end.may_write(part(5), "light")
    assert not fed.end.may_join(part(6))
    assert fed.end.dropped == {"login while no master is heard": 1}
    fed.beat()
    assert not fed.done()  # said once
    fed.hear(heard())
    assert fed.done() == [("say", f"the master is heard again after {fed.now - began:.1f} s")]
    assert fed.end.may_join(part(6))


def test_a_refusal_is_no_sign_of_a_master_and_is_told_again_only_after_a_while(gate: Gate) -> None:
    gate.end.start(gate.now)
    for after_s, told in ((0.0, True), (BEAT_S, False), (REFUSED_AGAIN_S, False), (REFUSED_AGAIN_S + 0.1, True)):
        gate.now += after_s
        gate.hear(AgentRefused(reason="no"))
        assert gate.done() == [("say", "the master does not take this agent: no")] * told
    gate.hear(AgentRefused(reason="never"))
    assert gate.done() == [("say", "the master does not take this agent: never")]
    gate.now += 10 * SILENT_S
    gate.beat()
    assert not gate.done()


def test_a_master_that_does_not_know_it_is_told_everything_again(fed: Gate) -> None:
    fed.end.joined(part(5))
    fed.end.joined(part(6))
    fed.hear(rights(1, LIGHT), rights(2))
    fed.end.session_ended(part(6), "gone")
    fed.sent()
    fed.hear(WhoIsThat())
    assert not fed.end.is_welcome
    assert fed.sent() == [AgentHello(boot=BOOT, name="pi")]
    assert fed.end.may_write(part(5), "light")  # until the master says otherwise
    fed.hear(welcome())
    assert [one.number for one in fed.sent() if isinstance(one, SessionOpen)] == [1]
    assert not any(isinstance(one, SessionOver) for one in fed.beat())
    fed.hear(rights(1, settled=0))
    assert fed.done()[-2:] == [("topics_changed",), ("rights_changed", 5)]
    assert not fed.end.may_write(part(5), "light")


def test_stop_of_the_master_is_passed_on_once_and_go_ends_it(fed: Gate) -> None:
    fed.hear(heard(), heard(stop=3))
    assert not fed.done()
    fed.hear(heard(stop=4, holds=True), heard(stop=4, holds=True))
    assert fed.done() == [("order", pnp_messages.NoticeKind.STOP, 4)]
    fed.hear(heard(stop=5, holds=True))
    assert fed.done() == [("order", pnp_messages.NoticeKind.STOP, 5)]
    fed.hear(heard(stop=5), heard(stop=5))
    assert fed.done() == [("order", pnp_messages.NoticeKind.GO, 5)]


def test_stop_on_its_links_is_repeated_until_the_master_confirms_that_one(fed: Gate) -> None:
    fed.end.stop_said("first")
    fed.end.stop_said("second")
    assert [(one.stops_said, one.words) for one in fed.sent() if isinstance(one, AgentBeat)] == [
        (1, "first"),
        (2, "second"),
    ]
    fed.hear(heard(stops_confirmed=1))
    (beat,) = fed.beat()
    assert isinstance(beat, AgentBeat)
    assert (beat.stops_said, beat.words) == (2, "second")
    fed.hear(heard(stops_confirmed=9), heard(stops_confirmed=0))  # more than was said; and late
    (beat,) = fed.beat()
    assert isinstance(beat, AgentBeat)
    assert (beat.stops_said, beat.words) == (0, "")
    fed.end.stop_said("third")
    (beat,) = fed.beat()
    assert isinstance(beat, AgentBeat)
    assert (beat.stops_said, beat.words) == (3, "third")


def test_the_master_learns_how_long_a_part_has_been_silent(fed: Gate) -> None:
    fed.end.joined(part(5))
    fed.sent()
    fed.hear(Sought(number=1), Sought(number=2))
    assert not fed.sent()  # nothing is known of it
    for silent_s, said_ms in ((0.0123, 12), (0.0, 0), (-1.0, 0), (1e9, 0xFFFFFFFF)):
        fed.around.heard[5] = fed.now - silent_s
        fed.hear(Sought(number=1))
        assert fed.sent() == [Sign(number=1, silent_ms=said_ms)]
        assert fed.done() == [("probe", 5)]


def test_the_master_may_end_a_session(fed: Gate) -> None:
    fed.end.joined(part(5))
    fed.hear(Close(number=2, reason="x"), Close(number=1, reason="blocked"))
    assert fed.done() == [("close", 5, "blocked")]


def test_a_flood_is_limited_and_told_at_most_once_a_minute(fed: Gate) -> None:
    fed.end.joined(part(5))
    fed.sent()
    words = "sends 2000 packets a second, more than its share of 500: the rest is not read"
    for after_s, told in ((0.0, True), (FLOOD_TOLD_S - 1, False), (1.0, True), (1.0, False)):
        fed.now += after_s
        assert fed.end.limits(part(5), 2000.4, 500.0)
        assert fed.sent() == [Remark(number=1, words=words)] * told
    assert fed.end.limits(part(6), 2000.0, 500.0)  # without a session
    assert not fed.sent()


def test_what_speaks_for_the_agent_itself_is_not_limited(gate: Gate) -> None:
    own = ClientInfo(1, "inproc", None, "in this process")
    assert gate.end.may_join(own)
    assert gate.end.may_write(own, "light")
    assert gate.end.may_read(own, "light")
    assert gate.end.is_settled(own)
    assert not gate.end.limits(own, 1e6, 1.0)
    gate.end.joined(own)
    gate.end.session_ended(own, "gone")
    assert not gate.sent()
    assert not gate.end.may_join(part(5))
    assert gate.end.limits(part(5), 1e6, 1.0)
    assert gate.end.limits_strangers()
    assert gate.end.keeps(part(5))
    assert gate.end.is_latched(pnp_messages.PROFILE_TOPIC)
    assert not gate.end.is_latched("light")


def test_whoever_has_no_rights_may_ask_the_inventory_and_read_who_the_robot_is(fed: Gate) -> None:
    fed.end.joined(part(5))
    assert fed.end.may_write(part(5), pnp_messages.INVENTORY_REQUEST_TOPIC)
    assert not fed.end.may_write(part(5), pnp_messages.PROFILE_TOPIC)
    assert not fed.end.may_write(part(5), "light")
    assert fed.end.may_read(part(6), pnp_messages.PROFILE_TOPIC)  # a session that is just being opened
    assert not fed.end.may_read(part(6), "light")
    assert not fed.end.may_read(part(5), "light")


def test_a_part_is_no_longer_held_when_its_topics_are_said_again(fed: Gate) -> None:
    def replies() -> bytes | None:
        reply = fed.end.reply_if_unserved(part(1), "light")
        return None if reply is None else reply(None)

    fed.end.joined(part(1))
    fed.hear(rights(1, LIGHT), Held(number=1, why="frozen"))
    assert replies() == encode_reply(ReplyStatus.NOT_PASSED, "frozen")
    fed.hear(rights(1, LIGHT))  # the verdict without topics was lost
    assert replies() is None


def test_who_leaves_takes_its_topics_along(fed: Gate) -> None:
    for key in (1, 2):
        fed.end.joined(part(key, key))
    fed.hear(rights(1, LIGHT), rights(2))
    assert [topic.topic for topic in fed.end.topics()] == ["light"]
    heard_by = (fed.end.may_read(part(1), "light"), fed.end.may_write(part(1), "light"))
    assert heard_by == (False, True)
    fed.done()
    fed.end.session_ended(part(2, 2), "bye")
    assert fed.done() == [("session_ended", 2)], "it had none"
    fed.end.session_ended(part(1), "bye")
    assert fed.done() == [("session_ended", 1), ("topics_changed",)]
    assert list(fed.end.topics()) == []


def test_a_topic_that_may_be_read_may_not_be_written(fed: Gate) -> None:
    fed.end.joined(part(1))
    fed.hear(rights(1, OpenTopic(topic="dark", topic_type="Dark", publishes=0, reliable=1)))
    assert (fed.end.may_read(part(1), "dark"), fed.end.may_write(part(1), "dark")) == (True, False)


@pytest.mark.parametrize(("is_welcome", "is_cut_off"), [(True, False), (True, True), (False, False), (False, True)])
def test_what_was_not_confirmed_is_repeated_to_a_master_that_listens_and_to_no_other(
    fed: Gate, is_welcome: bool, is_cut_off: bool
) -> None:
    for key in (1, 2):
        fed.end.joined(part(key, key))
    fed.end.session_ended(part(2, 2), "bye")
    if not is_welcome:
        fed.end.lost_master()
    if is_cut_off:
        fed.now += SILENT_S + 1
        fed.end.handle_timer(fed.now)
    else:
        fed.hear(heard())
    hello = [] if is_welcome else [AgentHello(boot=BOOT, name="pi")]
    again = (
        [
            SessionOpen(number=1, times=1, client_key=0xC1, reads_profile=0, address="CAN node 1"),
            SessionOver(number=2, reason="bye"),
        ]
        if is_welcome and not is_cut_off
        else []
    )
    said = [message for message in fed.beat() if not isinstance(message, AgentBeat)]
    assert said == [*hello, *again]
    assert fed.end.may_join(part(3, 3)) is (is_welcome and not is_cut_off)


def test_a_master_that_welcomes_it_anew_has_confirmed_nothing(fed: Gate) -> None:
    fed.end.joined(part(1))
    fed.hear(rights(1, LIGHT))
    kinds = (AgentBeat,)
    assert [message for message in fed.beat() if not isinstance(message, kinds)] == []
    fed.end.lost_master()
    fed.hear(welcome())
    opened = SessionOpen(number=1, times=1, client_key=0xC1, reads_profile=0, address="CAN node 1")
    assert fed.sent()[-1] == opened
    assert [message for message in fed.beat() if not isinstance(message, kinds)] == [opened]
    fed.hear(rights(1, LIGHT))
    assert [message for message in fed.beat() if not isinstance(message, kinds)] == []


def test_an_agent_that_is_refused_later_is_no_longer_welcome(fed: Gate) -> None:
    assert fed.end.is_welcome
    fed.hear(AgentRefused(reason="full"))
    assert not fed.end.may_join(part(1))
    assert AgentHello(boot=BOOT, name="pi") in fed.beat()


def test_how_long_a_part_was_silent_is_said_to_the_millisecond(fed: Gate) -> None:
    fed.end.joined(part(1))
    fed.sent()
    for silent_s, silent_ms in ((0.0, 0), (2.5, 2500), (-1.0, 0), (5e6, 0xFFFFFFFF)):
        fed.around.heard[1] = fed.now - silent_s
        fed.hear(Sought(number=1))
        assert fed.sent() == [Sign(number=1, silent_ms=silent_ms)]


def test_what_the_master_says_and_nobody_can_read_is_counted(fed: Gate) -> None:
    for octets in (b"", b"\xff", b"\x01", encode(welcome())[:-3]):
        fed.end.receive(octets, fed.now)
    assert fed.end.dropped == {"message of the master that cannot be read": 4}
