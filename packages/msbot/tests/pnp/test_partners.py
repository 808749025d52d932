"""A part hears when nobody publishes any more what it reads, and when somebody does again (design PNP 4)."""

from __future__ import annotations

from dataclasses import dataclass

from hypothesis import given
from hypothesis import strategies as st

from msbot.config import PartType, Slot
from msbot.pnp import THESIS_TIMING, Configuration, PartState, SlotBinding
from msbot.pnp.inventory_record import InventoryRecord
from msbot.pnp.state_changes import TopicIndex
from tests.pnp.robot import Rig, sample_store

AA, BB, CC, DD = 0xAA, 0xBB, 0xCC, 0xDD
TO_B, TO_C, TO_A = "HelloWorldTopic_1_to_2", "HelloWorldTopic_2_to_3", "HelloWorldTopic_3_to_1"

Heard = list[tuple[int, str, bool]]


def ring(rig: Rig) -> Heard:
    """All three parts of the ring are in."""
    for key, number in ((AA, "ABCD"), (BB, "EFGH"), (CC, "WXYZ")):
        rig.claim(key, number)
    heard: Heard = []
    rig.inventory.on_partner(lambda key, topic, is_there: heard.append((key, topic, is_there)))
    return heard


def test_the_part_that_reads_is_told_and_nobody_else() -> None:
    rig = Rig()
    heard = ring(rig)
    rig.leave(AA)
    assert heard == [(BB, TO_B, False)]
    rig.claim(AA, "ABCD")
    assert heard == [(BB, TO_B, False), (BB, TO_B, True)]


def test_silence_is_told_when_the_part_is_delisted_and_not_when_it_is_late() -> None:
    rig = Rig()
    heard = ring(rig)
    rig.run(3.0, AA, BB)
    assert heard == []
    rig.run(3.0, AA, BB)
    assert heard == [(AA, TO_A, False)]


def test_a_spare_that_takes_over_in_the_same_moment_leaves_nobody_alone() -> None:
    rig = Rig()
    rig.claim(BB, "EFGH")
    rig.claim(DD, "EFGH")
    heard = ring(rig)
    rig.leave(BB)
    assert rig.part(DD).slot == "BB"
    assert heard == []


def test_a_topic_with_two_senders_is_lost_with_the_second() -> None:
    def publishing(slot: str) -> Configuration:
        return Configuration(1, slot, (SlotBinding("out", "lux", "Light", publishes=True),))

    store = sample_store(Slot("L1", "LAMP"), Slot("L2", "LAMP"), Slot("M", "METER"))
    store.types |= {"LAMP": PartType("LAMP", "lamp"), "METER": PartType("METER", "meter")}
    store.configurations |= {
        "L1": publishing("L1"),
        "L2": publishing("L2"),
        "M": Configuration(1, "M", (SlotBinding("in", "lux", "Light", publishes=False),)),
    }
    rig = Rig(store)
    rig.claim(AA, "LAMP", name="L1")
    rig.claim(BB, "LAMP", name="L2")
    rig.claim(CC, "METER")
    heard: Heard = []
    rig.inventory.on_partner(lambda key, topic, is_there: heard.append((key, topic, is_there)))
    rig.leave(AA)
    assert heard == []
    rig.leave(BB)
    assert heard == [(CC, "lux", False)]


def test_a_part_that_comes_into_an_empty_room_is_told_nothing_but_who_comes_later() -> None:
    rig = Rig()
    heard: Heard = []
    rig.inventory.on_partner(lambda key, topic, is_there: heard.append((key, topic, is_there)))
    rig.claim(BB, "EFGH")
    assert heard == []
    rig.claim(AA, "ABCD")
    assert heard == [(BB, TO_B, True)]


def test_a_binding_that_is_taken_away_is_a_loss_for_the_reader() -> None:
    rig = Rig()
    heard = ring(rig)
    present = rig.store.configurations["AA"]
    rig.store.configurations["AA"] = Configuration(2, "AA", tuple(one for one in present.bindings if not one.publishes))
    rig.inventory.configuration_changed("AA")
    assert heard == [(BB, TO_B, False)]


def test_rights_and_events_are_told_first() -> None:
    rig = Rig()
    ring(rig)
    told: list[str] = []
    rig.inventory.on_partner(lambda *_: told.append("partner"))
    rig.inventory.on_rights(lambda _: told.append("rights"))
    rig.inventory.on_event(lambda _: told.append("event"))
    rig.leave(AA)
    assert told == ["rights", "event", "partner"]


@dataclass(frozen=True)
class Use:
    """What a part publishes and reads; nothing as long as it is not registered."""

    state: PartState
    is_held: bool
    out: frozenset[str]
    into: frozenset[str]

    def publishes(self, topic: str) -> bool:
        return self.is_in and not self.is_held and topic in self.out

    def reads(self, topic: str) -> bool:
        return self.is_in and topic in self.into

    @property
    def is_in(self) -> bool:
        return self.state in (PartState.ACTIVE, PartState.LATE)

    @property
    def is_there(self) -> bool:
        return any(self.publishes(topic) or self.reads(topic) for topic in "abc")


OUT = Use(PartState.LEFT, False, frozenset(), frozenset())
TOPICS = st.frozensets(st.sampled_from("abc"), max_size=2)
STATES = st.sampled_from([PartState.ACTIVE, PartState.ACTIVE, PartState.LATE, PartState.STANDBY, PartState.LOST])
TURNS = st.dictionaries(
    st.integers(1, 4), st.builds(Use, STATES, st.sampled_from([False, False, True]), TOPICS, TOPICS)
)


@given(st.lists(TURNS, min_size=2, max_size=6))
def test_who_was_there_before_and_reads_is_told_what_has_changed_within_a_turn(turns: list[dict[int, Use]]) -> None:
    partners = TopicIndex()
    records = {key: InventoryRecord(key, "peer", THESIS_TIMING, 0.0) for key in range(1, 5)}
    uses = dict.fromkeys(records, OUT)
    for turn in turns:
        before, uses = uses, {**uses, **turn}
        for key, use in turn.items():
            record = records[key]
            record.state, record.is_held = use.state, use.is_held
            record.configuration = Configuration(
                1,
                "AA",
                tuple(
                    SlotBinding(f"{topic} {publishes}", topic, "HelloWorld", publishes=publishes)
                    for topics, publishes in ((use.out, True), (use.into, False))
                    for topic in sorted(topics)
                ),
            )
            partners.touch(record)
            partners.touch(record)
        had, has = (
            {topic for topic in "abc" if any(use.publishes(topic) for use in all_of.values())}
            for all_of in (before, uses)
        )
        told = [
            (key, topic, topic in has)
            for topic in had ^ has
            for key, use in uses.items()
            if use.reads(topic) and before[key].is_there
        ]
        assert sorted(partners.refresh()) == sorted(told)
        assert {topic for topic in "abc" if partners.has_publisher(topic)} == has
