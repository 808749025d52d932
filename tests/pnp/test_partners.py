"""A part hears when nobody publishes any more what it reads, and when somebody does again (design PNP 4)."""

from __future__ import annotations

from msbot.config import PartType, Slot
from msbot.pnp import Configuration, SlotBinding
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
