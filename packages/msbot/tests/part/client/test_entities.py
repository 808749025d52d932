"""The wish list of a client: order, numbers, bounds, and beginning again."""

import pytest
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, precondition, rule

from msbot.part.client.entities import MAX_UNANSWERED, Entity, EntityTable, RunningRead
from msbot_xrce import Status
from msbot_xrce.errors import LocalProtocolError
from msbot_xrce.messages import DeliveryControl, Format, ObjectKind, ObjectVariant
from tests.effort import tries

TOPIC = ObjectVariant(ObjectKind.TOPIC, Format.BINARY, blob=b"x", parent_id=0x0011)
READER = ObjectVariant(ObjectKind.DATAREADER, Format.BINARY, blob=b"x", parent_id=0x0014)


def ask_all(table: EntityTable, now: float = 0.0, first_request: int = 10) -> list[int]:
    asked: list[int] = []
    while (entity := table.next_to_ask(now)) is not None:
        table.asked(entity, first_request + len(asked), now)
        asked.append(entity.object_id)
    return asked


def test_numbers_are_counted_per_kind_and_may_be_chosen() -> None:
    table = EntityTable(answer_s=2.0)
    assert [table.add(TOPIC).object_id for _ in range(2)] == [0x0012, 0x0022]
    assert table.add(READER).object_id == 0x0016
    assert table.add(TOPIC, 5).object_id == 0x0052
    assert table.add(READER, 0xFFE).object_id == 0xFFE6
    assert table.add(TOPIC, 0).describe == "topic 0x0002"


def test_a_number_is_not_given_again_soon() -> None:
    table = EntityTable(answer_s=2.0)
    first = table.add(TOPIC)
    assert table.remove(first)
    assert table.add(TOPIC).object_id != first.object_id
    assert not table.remove(first)


def test_a_free_number_is_found_after_the_last_one() -> None:
    table = EntityTable(answer_s=2.0)
    table.add(TOPIC, 1)
    table._next_number[ObjectKind.TOPIC] = 0xFFE
    assert table.add(TOPIC).object_id == 0xFFE2
    assert table.add(TOPIC).object_id == 0x0022


@pytest.mark.parametrize("number", [-1, 0xFFF])
def test_numbers_out_of_range_are_refused(number: int) -> None:
    with pytest.raises(LocalProtocolError, match="choose 0 to 4094"):
        EntityTable(answer_s=2.0).add(TOPIC, number)


def test_a_number_in_use_is_refused() -> None:
    table = EntityTable(answer_s=2.0)
    table.add(TOPIC, 1)
    with pytest.raises(LocalProtocolError, match="topic 0x0012 exists already"):
        table.add(TOPIC, 1)


def test_parents_are_asked_for_first_and_not_too_many_at_once() -> None:
    table = EntityTable(answer_s=2.0)
    wanted = [table.add(TOPIC).object_id for _ in range(MAX_UNANSWERED + 3)]
    assert ask_all(table) == wanted[:MAX_UNANSWERED]
    table.answered(10, Status.OK)
    assert ask_all(table, first_request=100) == wanted[MAX_UNANSWERED : MAX_UNANSWERED + 1]


def test_statuses_are_kept() -> None:
    table = EntityTable(answer_s=2.0)
    good, bad = table.add(TOPIC), table.add(READER)
    ask_all(table)
    assert not table.all_answered
    assert table.answered(10, Status.OK_MATCHED) is good
    assert table.answered(10, Status.OK) is None
    assert table.answered(999, Status.OK) is None
    table.answered(11, Status.ERR_DENIED)
    assert table.all_answered
    assert good.created
    assert not good.refused
    assert bad.refused
    assert not bad.created


def test_an_unanswered_creation_is_asked_again() -> None:
    table = EntityTable(answer_s=2.0)
    entity = table.add(TOPIC)
    assert table.timer() is None
    ask_all(table, 1.0)
    assert table.timer() == 3.0
    assert table.next_to_ask(2.9) is None
    assert table.next_to_ask(3.0) is entity
    table.asked(entity, 20, 3.0)
    assert table.timer() == 5.0
    assert table.answered(10, Status.OK) is None
    assert table.answered(20, Status.OK) is entity
    assert table.timer() is None


def test_a_read_waits_for_its_creation_to_be_asked() -> None:
    table = EntityTable(answer_s=2.0)
    reader = table.add(READER)
    reading = RunningRead(0x80, DeliveryControl())
    table.want_read(reader, reading)
    assert table.next_to_read() is None
    ask_all(table)
    assert table.next_to_read() == (reader, reading)
    reading.request_id = 11
    assert table.next_to_read() is None


def test_a_refused_reader_is_not_read() -> None:
    table = EntityTable(answer_s=2.0)
    reader = table.add(READER)
    ask_all(table)
    table.answered(10, Status.ERR_DDS_ERROR)
    table.want_read(reader, RunningRead(0x80, None))
    assert table.next_to_read() is None


def test_a_new_session_begins_from_nothing() -> None:
    table = EntityTable(answer_s=2.0)
    topic, reader = table.add(TOPIC), table.add(READER)
    table.want_read(reader, RunningRead(1, None))
    first = ask_all(table)
    table.answered(10, Status.OK)
    wanted = table.next_to_read()
    assert wanted is not None
    wanted[1].request_id = 12
    table.restart()
    assert table.timer() is None
    assert topic.status is None
    assert ask_all(table) == first == [entity.object_id for entity in table]
    assert table.next_to_read() is not None
    assert table.get(topic.object_id) is topic
    assert len(table) == 2


class AnyOrder(RuleBasedStateMachine):
    """However adding, removing, answering and losing mix: everything wished for ends up created and read."""

    def __init__(self) -> None:
        super().__init__()
        self.table = EntityTable(answer_s=2.0)
        self.now = 0.0
        self.request = 9
        self.open: dict[int, Entity] = {}

    @rule(reads=st.booleans())
    def add(self, reads: bool) -> None:
        entity = self.table.add(READER)
        if reads:
            self.table.want_read(entity, RunningRead(0x80, None))

    @precondition(lambda self: len(self.table) > 0)
    @rule(data=st.data())
    def remove(self, data: st.DataObject) -> None:
        self.table.remove(data.draw(st.sampled_from(list(self.table))))

    @rule()
    def flush(self) -> None:
        while (entity := self.table.next_to_ask(self.now)) is not None:
            self.request += 1
            self.table.asked(entity, self.request, self.now)
            self.open[self.request] = entity
        while (wanted := self.table.next_to_read()) is not None:
            self.request += 1
            wanted[1].request_id = self.request

    @precondition(lambda self: self.open)
    @rule(data=st.data())
    def answer(self, data: st.DataObject) -> None:
        self.table.answered(data.draw(st.sampled_from(sorted(self.open))), Status.OK)

    @rule()
    def time_passes(self) -> None:
        self.now += 1.5

    @rule()
    def lose(self) -> None:
        self.table.restart()
        self.open.clear()

    @invariant()
    def few_are_unanswered(self) -> None:
        assert sum(1 for entity in self.table if entity.request_id and entity.status is None) <= MAX_UNANSWERED

    def teardown(self) -> None:
        for _ in range(200):
            self.flush()
            for request_id in list(self.open):
                self.table.answered(request_id, Status.OK)
            self.now += 3.0
        assert self.table.all_answered
        assert all(entity.created for entity in self.table)
        assert all(entity.reading.request_id for entity in self.table if entity.reading is not None)


TestAnyOrder = AnyOrder.TestCase
TestAnyOrder.settings = settings(max_examples=tries(50, 2000), stateful_step_count=30, deadline=None)


def test_when_all_numbers_of_a_kind_are_taken_it_says_so_and_one_that_is_free_again_is_found() -> None:
    table = EntityTable(answer_s=2.0)
    topics = [table.add(TOPIC) for _ in range(0xFFE)]
    with pytest.raises(LocalProtocolError, match="4094 topics are there already"):
        table.add(TOPIC)
    assert table.add(READER)
    table.remove(topics[1234])
    assert table.add(TOPIC).object_id == topics[1234].object_id
