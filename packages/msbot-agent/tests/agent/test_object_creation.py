"""What each kind of CREATE makes: topics by name and id, quality of service, domains."""

from __future__ import annotations

import pytest

from msbot_agent.agent.agent_settings import AgentSettings
from msbot_agent.agent.object_creation import ClientObject, Creator, NoSuchTopic, Participant
from msbot_agent.space import THIS_PROGRAM, Deliver, Guid, MemorySpace, Owner, Qos, Reader, Space, Topic, Writer
from msbot_xrce.objects import (
    ParticipantDef,
    PublisherDef,
    ReaderDef,
    RequesterDef,
    SubscriberDef,
    TopicDef,
    WriterDef,
)
from tests.agent.hosts import FakeHost


class WatchedSpace:
    words: str | None = None
    """A memory space that remembers what was asked of it."""

    def __init__(self) -> None:
        self.made: list[tuple[Topic, Qos]] = []
        self.owners: list[Owner] = []
        self._space = MemorySpace()

    def writer(self, topic: Topic, qos: Qos, guid: Guid, owner: Owner = THIS_PROGRAM) -> Writer:
        self.made.append((topic, qos))
        self.owners.append(owner)
        return self._space.writer(topic, qos, guid, owner)

    def reader(self, topic: Topic, qos: Qos, deliver: Deliver, owner: Owner = THIS_PROGRAM) -> Reader:
        self.made.append((topic, qos))
        self.owners.append(owner)
        return self._space.reader(topic, qos, deliver, owner)


class Maker:
    """Creates objects one by one under one participant."""

    def __init__(self, settings: AgentSettings | None = None, domain_id: int = 0) -> None:
        self.space = WatchedSpace()
        space: Space = self.space
        self._creator = Creator(settings or AgentSettings())
        self._host = FakeHost(space)
        self.objects: dict[int, ClientObject] = {}
        self.root = self._creator.make(self._host, 0x0011, ParticipantDef(domain_id, "p"), None, self.objects)

    def topic(self, object_id: int, name: str, type_name: str = "T") -> Topic | None:
        entity = self._creator.make(self._host, object_id, TopicDef(name, type_name), self.root, self.objects)
        self.objects[object_id] = entity
        return entity.topic

    def endpoint(self, definition: WriterDef | ReaderDef | RequesterDef) -> list[tuple[Topic, Qos]]:
        self.space.made.clear()
        self._creator.make(self._host, 0x0015, definition, self.root, self.objects)
        return self.space.made


def writer(topic: int | str, *, keep_all: bool = False, depth: int | None = None) -> WriterDef:
    by_id = isinstance(topic, int)
    return WriterDef(
        topic if isinstance(topic, int) else None,
        None if by_id else str(topic),
        "said by the writer",
        reliable=True,
        transient_local=True,
        keep_all=keep_all,
        depth=depth,
    )


def test_what_a_client_makes_belongs_to_its_participant() -> None:
    maker = Maker()
    maker.topic(0x0012, "light", "Light")
    maker.endpoint(writer("light"))
    assert maker.space.owners == [Owner(1, "p")]


def test_a_writer_names_its_topic_by_id_or_by_name() -> None:
    maker = Maker()
    maker.topic(0x0012, "light", "Light")
    for name in (0x0012, 0x0010, "light"):
        ((topic, _),) = maker.endpoint(writer(name))
        assert topic == Topic("light", "Light", 0)


@pytest.mark.parametrize("name", [0x0022, "sound"])
def test_a_topic_must_exist_before_its_writers(name: int | str) -> None:
    maker = Maker()
    maker.topic(0x0012, "light")
    with pytest.raises(NoSuchTopic):
        maker.endpoint(writer(name))


def test_a_topic_of_another_participant_is_none_of_ours() -> None:
    maker = Maker()
    maker.objects[0x0022] = ClientObject(TopicDef("light", "T"), Participant(7, Owner(1)), Topic("light", "T", 7))
    with pytest.raises(NoSuchTopic):
        maker.endpoint(writer(0x0022))


def test_a_second_topic_of_one_name_is_the_first() -> None:
    maker = Maker()
    maker.topic(0x0012, "light", "Light")
    assert maker.topic(0x0022, "light", "Lamp") == Topic("light", "Light", 0)


def test_a_topic_goes_with_its_last_user() -> None:
    participant = Participant(0, Owner(1))
    participant.topic("light", "Light")
    participant.topic("light", "")
    participant.release("light")
    assert "light" in participant.topics
    participant.release("light")
    assert participant.topic("light", "Lamp") == Topic("light", "Lamp", 0)


@pytest.mark.parametrize(("asked", "domain"), [(0, 0), (42, 42), (255, 3)])
def test_domain_255_is_the_agents_choice(asked: int, domain: int) -> None:
    maker = Maker(AgentSettings(domain_255=3), asked)
    assert maker.topic(0x0012, "light") == Topic("light", "T", domain)


@pytest.mark.parametrize(
    ("definition", "depth"),
    [
        (writer("light"), 16),
        (writer("light", depth=1), 1),
        (writer("light", depth=60_000), 256),
        (writer("light", keep_all=True), 256),
    ],
)
def test_history_is_what_was_asked_for_within_limits(definition: WriterDef, depth: int) -> None:
    maker = Maker()
    maker.topic(0x0012, "light")
    ((_, qos),) = maker.endpoint(definition)
    assert qos == Qos(reliable=True, transient_local=True, keep_all=definition.keep_all, depth=depth)


def test_a_reader_is_made_as_asked() -> None:
    maker = Maker()
    maker.topic(0x0012, "light")
    ((_, qos),) = maker.endpoint(ReaderDef(0x0012, None, None, reliable=False, transient_local=False, depth=2))
    assert qos == Qos(reliable=False, depth=2)


def test_a_requester_needs_no_topic_objects() -> None:
    maker = Maker(domain_id=4)
    assert [topic for topic, _ in maker.endpoint(RequesterDef("s", "Q", "A", "rq", "rr"))] == [
        Topic("rq", "Q", 4),
        Topic("rr", "A", 4),
    ]


def test_publishers_and_subscribers_only_stand_there() -> None:
    maker = Maker()
    for definition in (PublisherDef(), SubscriberDef()):
        entity = Creator(AgentSettings()).make(FakeHost(), 0x0013, definition, maker.root, {})
        assert (entity.topic_name, entity.endpoint, entity.is_attached) == (None, None, True)
