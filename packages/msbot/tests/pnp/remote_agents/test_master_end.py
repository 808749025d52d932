"""What the master knows of agents elsewhere: who is taken, whose sessions are whose, and for how long."""

from __future__ import annotations

import math
from random import Random
from typing import Any

import pytest

from msbot.pnp import Claim, Inventory, PartEvent, Profile, RobotGate
from msbot.pnp.remote_agents.agent_messages import (
    VERSION,
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
    MasterHeard,
    Remark,
    Rights,
    SessionOpen,
    SessionOver,
    Sign,
    Sought,
    WhoIsThat,
)
from msbot.pnp.remote_agents.master_side import LONGEST_NAME, MAX_AGENTS, MAX_SESSIONS_OF_AGENT, SEALED, MasterSide
from tests.pnp.remote_agents.test_ends import AGENT, TIMING, sample_slots

SILENT_S, FORGOTTEN_AFTER_S = 2.0, 60.0
SHOWN = 0xC1


class Around:
    """The master: keeps what is done to it."""

    def __init__(self) -> None:
        self.sent: list[tuple[int, FromMaster]] = []
        self.done: list[tuple[Any, ...]] = []
        self.stop = (0, False)

    def send(self, agent: int, message: FromMaster) -> None:
        self.sent.append((agent, message))

    def stop_number(self) -> tuple[int, bool]:
        return self.stop

    def __getattr__(self, name: str) -> Any:
        return lambda *values: self.done.append((name, *values))


class Master:
    """A master that agents may come to, and its time."""

    def __init__(self, *, sealed: bool = False) -> None:
        self.now = 100.0
        self.around = Around()
        self.inventory = Inventory(sample_slots(), random=Random(1), now=self.now, timing=TIMING)
        access = RobotGate(self.inventory, clock=lambda: self.now)
        self.end = MasterSide(access, self.inventory, Profile(), self.around, random=Random(2), sealed=sealed)
        access.use_agents(self.end, lambda _: None)

    def hear(self, *messages: FromAgent, agent: int = AGENT) -> list[FromMaster]:
        """An agent speaks; what the master says to it then."""
        self.around.sent.clear()
        for message in messages:
            self.end.receive(agent, message, self.now)
        return [said for to, said in self.around.sent if to == agent]

    def done(self) -> list[tuple[Any, ...]]:
        """What was done to the master since the last time."""
        done, self.around.done = self.around.done, []
        return done

    def key(self) -> int:
        """The key of the newest session here."""
        return list(self.end._places)[-1]

    def states(self) -> list[tuple[str, str]]:
        """State and reason of every part."""
        return [(info.state.value, info.reason) for info in self.inventory.view(self.now)]

    def register(self) -> int:
        """Its newest session becomes a part in slot 0."""
        self.inventory.claim(Claim("PART", "slot0", b"a part 0"), self.key(), self.now)
        return self.key()


def opened(number: int = 1, times: int = 1, *, reads_profile: int = 1, client_key: int = SHOWN) -> SessionOpen:
    return SessionOpen(
        number=number, times=times, client_key=client_key, reads_profile=reads_profile, address="CAN node 1"
    )


def hello(boot: int = 7, name: str = "pi") -> AgentHello:
    return AgentHello(boot=boot, name=name)


@pytest.fixture
def master() -> Master:
    return Master()


@pytest.fixture
def fed(master: Master) -> Master:
    """A master with one agent."""
    master.hear(hello())
    master.done()
    return master


def test_an_agent_is_welcome_and_said_once(master: Master) -> None:
    assert master.end.timer() == math.inf
    (welcome,) = master.hear(hello())
    assert isinstance(welcome, AgentWelcome)
    assert (welcome.boot, welcome.robot) == (7, Profile().name)
    assert master.done() == [("say", "the agent pi brings parts")]
    assert master.end.names() == [("pi", 0, False)]
    assert master.hear(hello()) == [welcome]
    assert not master.done()


@pytest.mark.parametrize(
    ("message", "words"),
    [
        (AgentHello(boot=1, name="x", version=VERSION + 1), "it speaks version 2 of this protocol, the master speaks "),
        (hello(name=""), "its name has to be printable, and of at most 40 characters"),
        (hello(name="a\nb"), "its name has to be printable, and of at most 40 characters"),
        (hello(name="x" * (LONGEST_NAME + 1)), "its name has to be printable, and of at most 40 characters"),
    ],
)
def test_who_is_not_taken_reads_why(master: Master, message: AgentHello, words: str) -> None:
    (refused,) = master.hear(message)
    assert isinstance(refused, AgentRefused)
    assert refused.reason.startswith(words)
    assert not master.end.knows(AGENT)
    assert master.hear(hello(name="x" * LONGEST_NAME))[0] != refused
    assert master.end.knows(AGENT)


def test_a_robot_that_seals_its_samples_takes_no_agent() -> None:
    assert Master(sealed=True).hear(hello()) == [AgentRefused(reason=SEALED)]


def test_so_many_agents_and_not_one_more(master: Master) -> None:
    for number in range(1, MAX_AGENTS + 1):
        assert isinstance(master.hear(hello(name=f"pi{number}"), agent=number)[0], AgentWelcome)
    assert master.hear(hello(name="one more"), agent=99) == [AgentRefused(reason="64 agents are there already")]
    assert isinstance(master.hear(hello(boot=8, name="pi5"), agent=5)[0], AgentWelcome)  # it has its place


def test_so_many_sessions_of_an_agent_and_not_one_more(fed: Master) -> None:
    for number in range(1, MAX_SESSIONS_OF_AGENT + 2):
        fed.hear(opened(number))
    assert fed.end.names() == [("pi", MAX_SESSIONS_OF_AGENT, False)]
    assert fed.end.dropped == {"session of an agent beyond its share": 1}


def test_a_session_is_told_its_rights_and_known_by_a_key_of_its_own(fed: Master) -> None:
    assert fed.hear(opened(reads_profile=0)) == [Rights(number=1, times=1, reads_profile=0, settled=0, topics=[])]
    key = fed.key()
    assert fed.end.has(key)
    assert not fed.end.has(key + 1)
    assert fed.end._places[key][0].sessions[1].client.client_key == SHOWN
    assert fed.hear(opened()) == [Rights(number=1, times=1, reads_profile=1, settled=0, topics=[])]
    (info,) = fed.inventory.view(fed.now)
    assert (info.client_key, info.address) == (key, "CAN node 1 by agent pi")
    assert fed.hear(opened(2, client_key=0))
    assert fed.end._places[fed.key()][0].sessions[2].client.client_key == fed.key()


def test_a_session_that_is_opened_again_has_to_ask_again(fed: Master) -> None:
    fed.hear(opened())
    key = fed.register()
    fed.hear(opened(2))
    (rights,) = fed.hear(opened())  # said again
    assert isinstance(rights, Rights)
    assert rights.settled
    assert [topic.topic for topic in rights.topics] == ["slot0_topic"]
    rights = fed.hear(opened(times=2, reads_profile=0))[-1]
    assert isinstance(rights, Rights)
    assert (rights.times, rights.reads_profile, rights.settled) == (2, 0, 0)
    assert fed.end.has(key)
    (rights,) = fed.hear(opened(times=1))  # late: of the one before
    assert isinstance(rights, Rights)
    assert (rights.times, rights.reads_profile) == (2, 0)


def test_a_session_that_is_over_is_forgotten_and_confirmed_however_often_it_is_said(fed: Master) -> None:
    fed.hear(opened())
    key = fed.register()
    assert fed.end.may(AGENT, "slot0_topic", publishes=True)
    fed.done()
    for _ in range(2):
        assert fed.hear(SessionOver(number=1, reason="session deleted"))[-1] == Forgotten(number=1)
    assert not fed.end.has(key)
    assert not fed.end.may(AGENT, "slot0_topic", publishes=True)
    assert fed.done() == [("recheck", AGENT)]
    assert fed.states() == [("left", "session deleted")]


def test_what_is_said_about_a_session(fed: Master) -> None:
    fed.hear(opened())
    key = fed.register()
    fed.done()
    assert fed.end.heard_at(key) is None
    assert fed.end.heard_at(key + 1) is None
    fed.hear(Ask(number=1, compat=1, identity=bytes(24), body=b"1"))
    assert fed.done() == [("ask", key, True, bytes(24), b"1")]
    assert fed.end.heard_at(key) is None
    fed.hear(Sign(number=1, silent_ms=250))
    assert fed.end.heard_at(key) == fed.now - 0.25
    assert not fed.done()
    noted: list[PartEvent] = []
    fed.inventory.on_event(noted.append)
    fed.hear(Remark(number=1, words="sends too much"))
    assert [event.reason for event in noted] == ["sends too much"]
    assert fed.end.heard_at(key) == fed.now - 0.25
    fed.hear(*(one(number=9, **rest) for one, rest in ((Sign, {"silent_ms": 0}), (Remark, {"words": "x"}))))
    assert fed.end.dropped == {"message about an unknown session of an agent": 2}


def test_what_the_master_says_about_a_session_goes_to_its_agent(fed: Master) -> None:
    fed.hear(opened(5))
    key = fed.key()
    sent = fed.around.sent
    sent.clear()
    fed.end.probe(key)
    fed.end.close(key, "blocked")
    assert fed.end.answer(key, in_compat=True, identity=bytes(24), body=b"1")
    assert sent == [
        (AGENT, Sought(number=5)),
        (AGENT, Close(number=5, reason="blocked")),
        (AGENT, Answer(number=5, compat=1, identity=bytes(24), body=b"1")),
    ]
    sent.clear()
    fed.end.probe(key + 1)
    fed.end.close(key + 1, "blocked")
    assert not fed.end.answer(key + 1, in_compat=True, identity=bytes(24), body=b"1")
    fed.end.rights_changed(key + 1)
    assert not sent


def test_every_beat_is_answered_with_the_stop_that_holds_and_says_each_new_one_once(fed: Master) -> None:
    (answer,) = fed.hear(AgentBeat(count=3, stops_said=0, words=""))
    assert answer == MasterHeard(count=3, stop=0, holds=0, stops_confirmed=0)
    fed.around.stop = (4, True)
    for stops, done in ((1, ["pi", "button"]), (1, []), (3, ["pi", "button"]), (2, [])):
        (answer,) = fed.hear(AgentBeat(count=3, stops_said=stops, words="button"))
        assert answer == MasterHeard(count=3, stop=4, holds=1, stops_confirmed=3 if stops == 2 else stops)
        assert fed.done() == ([("stop_said", *done)] if done else [])
    fed.around.sent.clear()
    fed.end.tell_stop()
    assert fed.around.sent == [(AGENT, MasterHeard(count=0, stop=4, holds=1, stops_confirmed=3))]


def test_with_every_beat_the_rights_of_one_session_are_said_again(fed: Master) -> None:
    for number in (3, 5, 9):
        fed.hear(opened(number))
    fed.hear(SessionOver(number=5, reason="gone"))
    told = [fed.hear(AgentBeat(count=count, stops_said=0, words="")) for count in range(4)]
    assert [[one.number for one in said if isinstance(one, Rights)] for said in told] == [[3], [9], [3], [9]]


def test_an_agent_is_silent_after_two_seconds_and_forgotten_after_a_minute(fed: Master) -> None:
    fed.hear(opened())
    key = fed.register()
    fed.done()
    heard_at = fed.now
    assert fed.end.timer() == heard_at + SILENT_S
    fed.end.handle_timer(heard_at + SILENT_S - 0.01)
    assert fed.end.names() == [("pi", 1, False)]
    fed.now = heard_at + SILENT_S
    fed.end.handle_timer(fed.now)
    assert fed.end.names() == [("pi", 0, True)]
    assert fed.states() == [("lost", "gone: the agent pi is silent")]
    assert fed.done() == [("say", "the agent pi is silent"), ("recheck", AGENT)]
    assert not fed.end.has(key)
    assert fed.hear(AgentBeat(count=1, stops_said=0, words="")) == [WhoIsThat()]
    fed.end.handle_timer(fed.now)
    assert not fed.done()
    assert fed.end.timer() == heard_at + FORGOTTEN_AFTER_S
    fed.end.handle_timer(heard_at + FORGOTTEN_AFTER_S - 0.01)
    assert fed.end.knows(AGENT)
    fed.end.handle_timer(heard_at + FORGOTTEN_AFTER_S)
    assert not fed.end.knows(AGENT)


def test_whatever_an_agent_says_is_a_sign_of_it(fed: Master) -> None:
    for message in (hello(), AgentBeat(count=1, stops_said=0, words=""), opened(), SessionOver(number=1, reason="x")):
        fed.now += 1.9
        fed.hear(message)
        assert fed.end.timer() == fed.now + SILENT_S


def test_an_agent_that_was_silent_or_started_again_begins_anew(fed: Master) -> None:
    fed.hear(opened())
    fed.register()
    fed.done()
    fed.hear(hello(boot=8))
    assert fed.states() == [("lost", "gone: the agent pi was started again")]
    assert ("say", "the agent pi brings parts") in fed.done()
    assert fed.end.names() == [("pi", 0, False)]
    fed.now += SILENT_S
    fed.end.handle_timer(fed.now)
    fed.done()
    assert fed.hear(opened()) == [WhoIsThat()]
    fed.hear(hello(boot=8))
    assert fed.done() == [("say", "the agent pi brings parts")]
    assert fed.end.names() == [("pi", 0, False)]


def test_when_the_session_of_an_agent_ends_its_parts_are_gone(fed: Master) -> None:
    fed.hear(opened())
    fed.register()
    fed.done()
    fed.end.agent_left(AGENT + 1)
    assert not fed.done()
    fed.end.agent_left(AGENT)
    assert fed.done()[0] == ("say", "the agent pi has ended")
    assert fed.states() == [("lost", "gone: the agent pi has ended")]
    assert not fed.end.knows(AGENT)


def test_a_stranger_is_asked_who_it_is_and_its_stop_is_nobodys(master: Master) -> None:
    assert master.hear(AgentBeat(count=1, stops_said=1, words="x")) == [WhoIsThat()]
    assert not master.done()
    master.end.tell_stop()
    assert not master.around.sent[1:]


def test_an_agent_is_not_shown_as_a_part_and_its_sessions_are(master: Master) -> None:
    master.inventory.client_joined(AGENT, "peer 1", master.now)
    assert master.states() == [("new", "a session was opened from peer 1")]
    master.hear(hello())
    assert master.states() == []
    master.hear(opened(1, reads_profile=0), opened(2))
    assert master.states() == [
        ("new", "a session was opened from CAN node 1 by agent pi"),
        ("checking", "reads the robot's profile (step 1)"),
    ]
    master.hear(opened(1))
    assert [state for state, _ in master.states()] == ["checking", "checking"]


@pytest.mark.parametrize(
    ("name", "is_taken"),
    [("", False), ("x", True), ("x" * LONGEST_NAME, True), ("x" * (LONGEST_NAME + 1), False), ("a\tb", False)],
)
def test_which_names_an_agent_may_have(master: Master, name: str, is_taken: bool) -> None:
    (answer,) = master.hear(hello(name=name))
    assert isinstance(answer, AgentWelcome if is_taken else AgentRefused)
    assert [known for known, _, _ in master.end.names()] == [name] * is_taken


class Dice(Random):
    """Throws what it is told; the last side again and again."""

    def __init__(self, *sides: int) -> None:
        super().__init__()
        self.sides = [*sides]

    def getrandbits(self, bits: int) -> int:
        side = self.sides.pop(0) if len(self.sides) > 1 else self.sides[0]
        return (1 << bits) - 1 if side < 0 else side


def test_the_key_of_a_session_here_is_drawn_until_nobody_has_it_and_never_0(master: Master) -> None:
    master.hear(hello())
    master.inventory.client_joined(9, "peer 9", master.now)
    for number, (sides, key) in enumerate([((9, 9, 8), 8), ((8, 9, 7), 7), ((-1, 0), 0xFFFFFFFF)], 1):
        master.end._random = Dice(*sides)
        master.hear(opened(number))
        assert master.key() == key
        master.inventory.client_joined(key, "peer", master.now)
    master.end._random = Dice(0)
    master.hear(opened(4))
    assert master.key() != 0
