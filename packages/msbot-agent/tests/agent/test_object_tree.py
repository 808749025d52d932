"""CREATE and DELETE: modes, parents, statuses (cases 23 to 34 of the reference)."""

from __future__ import annotations

import logging

import pytest

from msbot_agent.agent.agent_settings import AgentSettings
from msbot_agent.agent.object_tree import ObjectBudget, ObjectTree
from msbot_xrce import Status
from msbot_xrce.messages import Format, ObjectKind, ObjectVariant, make_object_id
from msbot_xrce.objects import (
    EndpointQos,
    participant_variant,
    publisher_variant,
    reader_variant,
    replier_variant,
    requester_variant,
    subscriber_variant,
    topic_variant,
    writer_variant,
)
from msbot_xrce.sessions import CreateRequested
from tests.agent.hosts import FakeHost

PARTICIPANT, TOPIC, PUBLISHER, SUBSCRIBER, WRITER, READER, REQUESTER, REPLIER = (
    make_object_id(1, kind) for kind in range(1, 9)
)
ALL = {
    PARTICIPANT: participant_variant("p"),
    TOPIC: topic_variant("light", "Light", PARTICIPANT),
    PUBLISHER: publisher_variant(PARTICIPANT),
    SUBSCRIBER: subscriber_variant(PARTICIPANT),
    WRITER: writer_variant(TOPIC, PUBLISHER),
    READER: reader_variant(TOPIC, SUBSCRIBER),
    REQUESTER: requester_variant("s", "Q", "A", "rq", "rr", PARTICIPANT),
    REPLIER: replier_variant("s", "Q", "A", "rq", "rr", PARTICIPANT),
}
DIFFERENT = {
    PARTICIPANT: participant_variant("p", domain=5),
    TOPIC: topic_variant("light", "Lamp", PARTICIPANT),
    WRITER: writer_variant(TOPIC, PUBLISHER, EndpointQos(reliable=False)),
    READER: reader_variant(TOPIC, SUBSCRIBER, EndpointQos(depth=3)),
    REQUESTER: requester_variant("s", "Q", "B", "rq", "rr", PARTICIPANT),
    REPLIER: replier_variant("s", "Q", "A", "rq2", "rr", PARTICIPANT),
}


class Tree(ObjectTree):
    """A tree with short verbs."""

    def __init__(self, settings: AgentSettings | None = None, budget: int = 1000) -> None:
        self.host = FakeHost()
        super().__init__(settings or AgentSettings(), ObjectBudget(budget))

    def make(self, object_id: int, variant: ObjectVariant, *, reuse: bool = False, replace: bool = False) -> Status:
        return self.create(self.host, CreateRequested(10, object_id, variant, reuse, replace, 0x80, True))

    def drop(self, object_id: int) -> Status:
        return self.delete(self.host, object_id)

    def make_all(self) -> None:
        for object_id, variant in ALL.items():
            assert self.make(object_id, variant) is Status.OK


def xml(kind: ObjectKind, text: str, parent_id: int = PARTICIPANT) -> ObjectVariant:
    return ObjectVariant(kind, Format.XML, text=text, parent_id=parent_id)


def test_all_kinds_are_made() -> None:
    tree = Tree()
    tree.make_all()
    assert len(tree) == 8
    assert sorted(tree.endpoints) == [WRITER, READER, REQUESTER, REPLIER]
    assert [(f"{object_id:04x}", entity.topic_name) for object_id, entity in tree.items()] == [
        ("0011", None),
        ("0012", "light"),
        ("0013", None),
        ("0014", None),
        ("0015", "light"),
        ("0016", "light"),
        ("0017", "rq"),
        ("0018", "rr"),
    ]


@pytest.mark.parametrize("object_id", ALL, ids=lambda object_id: f"{object_id:04x}")
@pytest.mark.parametrize(
    ("reuse", "replace", "status"),
    [
        (False, False, Status.ERR_ALREADY_EXISTS),
        (False, True, Status.OK),
        (True, False, Status.OK_MATCHED),
        (True, True, Status.OK_MATCHED),
    ],
)
def test_creating_an_equal_object_again(object_id: int, reuse: bool, replace: bool, status: Status) -> None:
    tree = Tree()
    tree.make_all()
    before = tree.endpoints.get(object_id)
    assert tree.make(object_id, ALL[object_id], reuse=reuse, replace=replace) is status
    if before is not None:
        assert (tree.endpoints[object_id] is before) == (status is not Status.OK)
    assert len(tree) == 8


@pytest.mark.parametrize("object_id", DIFFERENT, ids=lambda object_id: f"{object_id:04x}")
@pytest.mark.parametrize(
    ("reuse", "replace", "status"),
    [
        (False, False, Status.ERR_ALREADY_EXISTS),
        (False, True, Status.OK),
        (True, False, Status.ERR_MISMATCH),
        (True, True, Status.OK),
    ],
)
def test_creating_a_different_object_again(object_id: int, reuse: bool, replace: bool, status: Status) -> None:
    tree = Tree()
    tree.make_all()
    assert tree.make(object_id, DIFFERENT[object_id], reuse=reuse, replace=replace) is status
    replaced = status is Status.OK
    again = tree.make(object_id, DIFFERENT[object_id], reuse=True)
    assert again is (Status.OK_MATCHED if replaced else Status.ERR_MISMATCH)


def test_replacing_by_something_impossible_loses_the_old_one() -> None:
    tree = Tree()
    tree.make_all()
    assert tree.make(TOPIC, xml(ObjectKind.TOPIC, "<dds><nope"), replace=True) is Status.ERR_DDS_ERROR
    assert tree.drop(TOPIC) is Status.ERR_UNKNOWN_REFERENCE


def test_reusing_with_something_unreadable_is_a_mismatch() -> None:
    tree = Tree()
    tree.make_all()
    assert tree.make(TOPIC, xml(ObjectKind.TOPIC, "<dds><nope"), reuse=True) is Status.ERR_MISMATCH
    assert tree.drop(TOPIC) is Status.OK


@pytest.mark.parametrize("object_id", [object_id for object_id in ALL if object_id != PARTICIPANT])
def test_children_need_their_parent(object_id: int) -> None:
    assert Tree().make(object_id, ALL[object_id]) is Status.ERR_UNKNOWN_REFERENCE


def test_the_kind_of_the_variant_counts_not_that_of_the_id() -> None:
    tree = Tree()
    assert tree.make(0x0055, participant_variant("p")) is Status.OK
    assert tree.drop(0x0055) is Status.ERR_UNKNOWN_REFERENCE
    assert tree.drop(0x0051) is Status.OK


def test_the_kind_of_a_parent_id_does_not_count() -> None:
    tree = Tree()
    assert tree.make(PARTICIPANT, ALL[PARTICIPANT]) is Status.OK
    assert tree.make(TOPIC, topic_variant("light", "Light", PARTICIPANT | 0xF)) is Status.OK


@pytest.mark.parametrize(
    ("kind", "status"),
    [
        (0x00, Status.ERR_DDS_ERROR),
        (0x09, Status.ERR_DDS_ERROR),
        (0x0A, Status.OK),
        (0x0B, Status.OK),
        (0x0C, Status.OK),
        (0x0D, Status.OK),
        (0x0F, Status.OK),
    ],
)
def test_kinds_that_nobody_makes(kind: int, status: Status) -> None:
    tree = Tree()
    assert tree.make(0x0060 | kind, ObjectVariant(kind, 2, text="x")) is status
    assert len(tree) == 0


@pytest.mark.parametrize(
    "variant",
    [
        ObjectVariant(ObjectKind.PARTICIPANT, 9),
        ObjectVariant(ObjectKind.PARTICIPANT, Format.BINARY, blob=b"\0"),
        ObjectVariant(ObjectKind.PARTICIPANT, Format.BINARY, blob=b"\x07\0"),
        ObjectVariant(ObjectKind.PARTICIPANT, Format.XML, text="<<<"),
    ],
)
def test_what_cannot_be_read_is_refused_and_counted(variant: ObjectVariant) -> None:
    tree = Tree()
    assert tree.make(PARTICIPANT, variant) is Status.ERR_DDS_ERROR
    assert tree.host.dropped == {"CREATE with a representation that cannot be used": 1}
    assert len(tree) == 0


def test_a_publisher_by_reference_is_refused() -> None:
    tree = Tree()
    assert tree.make(PARTICIPANT, ALL[PARTICIPANT]) is Status.OK
    by_reference = ObjectVariant(ObjectKind.PUBLISHER, Format.REFERENCE, parent_id=PARTICIPANT)
    assert tree.make(PUBLISHER, by_reference) is Status.ERR_DDS_ERROR


def test_deleting_a_parent_leaves_the_children_known_and_working() -> None:
    tree = Tree()
    tree.make_all()
    for parent in (PARTICIPANT, PUBLISHER, TOPIC):
        assert tree.drop(parent) is Status.OK
    tree.endpoints[WRITER].write(1, b"x")
    assert tree.host.traffic["light"].published == 1
    assert tree.make(make_object_id(2, ObjectKind.TOPIC), ALL[TOPIC]) is Status.ERR_UNKNOWN_REFERENCE
    for child in (WRITER, READER, SUBSCRIBER, REQUESTER, REPLIER):
        assert tree.drop(child) is Status.OK
    assert len(tree) == 0


def test_deleting_what_does_not_exist() -> None:
    assert Tree().drop(0xFFFD) is Status.ERR_UNKNOWN_REFERENCE
    tree = Tree()
    tree.make_all()
    assert tree.drop(WRITER) is Status.OK
    assert tree.drop(WRITER) is Status.ERR_UNKNOWN_REFERENCE
    assert WRITER not in tree.endpoints


def test_clear_leaves_nothing() -> None:
    tree = Tree(budget=8)
    tree.make_all()
    tree.clear()
    assert len(tree) == 0
    assert not tree.endpoints
    tree.make_all()


def test_more_objects_than_allowed_are_refused_with_the_reason(caplog: pytest.LogCaptureFixture) -> None:
    tree = Tree(AgentSettings(max_objects=2))
    for number in (1, 2):
        assert tree.make(make_object_id(number, 1), participant_variant("p")) is Status.OK
    assert tree.make(make_object_id(3, 1), participant_variant("p")) is Status.ERR_RESOURCES
    assert tree.make(make_object_id(3, 1), participant_variant("p")) is Status.ERR_RESOURCES
    assert tree.host.dropped == {"object beyond 2 of one client": 2}
    assert caplog.text.count("object 0031 is refused") == 1, "said once"
    assert tree.drop(make_object_id(1, 1)) is Status.OK
    assert tree.make(make_object_id(3, 1), participant_variant("p")) is Status.OK


def test_all_clients_share_one_budget() -> None:
    tree = Tree(budget=1)
    assert tree.make(0x0011, participant_variant("p")) is Status.OK
    assert tree.make(0x0021, participant_variant("p")) is Status.ERR_RESOURCES
    assert tree.make(0x0011, participant_variant("other"), replace=True) is Status.OK


def test_a_refused_object_costs_nothing() -> None:
    tree = Tree(budget=3)
    assert tree.make(PARTICIPANT, ALL[PARTICIPANT]) is Status.OK
    assert tree.make(PUBLISHER, ALL[PUBLISHER]) is Status.OK
    for _ in range(5):
        assert tree.make(WRITER, ALL[WRITER]) is Status.ERR_DDS_ERROR, "its topic does not exist"
    assert tree.make(TOPIC, ALL[TOPIC]) is Status.OK


def test_with_ced_any_text_names_a_topic_and_without_it_is_refused() -> None:
    kinds = (
        (PARTICIPANT, ObjectKind.PARTICIPANT, 0),
        (TOPIC, ObjectKind.TOPIC, PARTICIPANT),
        (PUBLISHER, ObjectKind.PUBLISHER, PARTICIPANT),
        (WRITER, ObjectKind.DATAWRITER, PUBLISHER),
    )
    named, strict = Tree(AgentSettings(any_text_is_a_name=True)), Tree()
    for object_id, kind, parent_id in kinds:
        variant = ObjectVariant(kind, Format.REFERENCE, text="any name", parent_id=parent_id)
        assert named.make(object_id, variant) is Status.OK
        assert named.make(object_id, variant, reuse=True) is Status.OK_MATCHED
    assert named.endpoints[WRITER].topic == "any name"
    assert strict.make(PARTICIPANT, xml(ObjectKind.PARTICIPANT, "<no xml")) is Status.ERR_DDS_ERROR


def test_every_refusal_is_counted_with_its_reason_and_said_once(caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.INFO)
    tree = Tree()
    tree.make_all()
    other = make_object_id(2, ObjectKind.DATAWRITER)
    refused = [
        ("CREATE of an object that is there already", Status.ERR_ALREADY_EXISTS, TOPIC, ALL[TOPIC], False),
        ("CREATE of an object that is there, but differs", Status.ERR_MISMATCH, TOPIC, DIFFERENT[TOPIC], True),
        ("CREATE without its parent", Status.ERR_UNKNOWN_REFERENCE, other, writer_variant(TOPIC, 0x0993), False),
        ("CREATE of a kind that cannot be created", Status.ERR_DDS_ERROR, 0x0069, ObjectVariant(9, 2, text="x"), False),
        (
            "CREATE for a topic that its participant does not have",
            Status.ERR_DDS_ERROR,
            other,
            writer_variant(0x0772, PUBLISHER),
            False,
        ),
    ]
    for reason, status, object_id, variant, reuse in refused:
        for _ in range(2):
            assert tree.make(object_id, variant, reuse=reuse) is status, reason
        assert tree.host.dropped[reason] == 2
        assert caplog.text.count(f"object {object_id:04X} is refused: {reason}") == 1, "said once"
    assert "(0993)" in caplog.text, "the parent is named"
    assert "(topic 0772)" in caplog.text
    assert len(tree.host.dropped) == len(refused)


def test_what_a_client_creates_and_deletes_is_said_in_detail(caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.INFO)
    tree = Tree()
    tree.make_all()
    assert caplog.text == "", "not at -v 4"
    caplog.set_level(logging.DEBUG)
    assert tree.drop(WRITER) is Status.OK
    assert tree.make(WRITER, ALL[WRITER]) is Status.OK
    assert "deleted datawriter 0015: light" in caplog.text
    assert "created datawriter 0015: light" in caplog.text
