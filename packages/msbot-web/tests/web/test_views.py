"""What can be seen of a robot that runs: slots, arrivals, topics, bus, past and library."""

from __future__ import annotations

import asyncio
import json
from pathlib import Path

import pytest

from msbot.operations.rights import Role
from msbot.part import HelloWorld
from msbot_agent.link.can.protocol import Frame
from msbot_web.glances import ShownSlot
from msbot_web.models.robot_models import SlotCard
from msbot_web.svg.drawings import done_fields
from msbot_xrce.errors import NotThere
from tests.operations.stage import AA_IS_A_DIAL
from tests.web.rig import Rig, ToyBench, show


def test_slots_stand_in_the_order_of_the_blueprint_with_part_beat_and_wires(tmp_path: Path) -> None:
    async def scene(rig: Rig) -> None:
        await rig.look(3.0)
        first, second, third = rig.views.slots()
        assert [card.name for card in (first, second, third)] == ["AA", "BB", "CC"]
        assert (first.state, first.part_number, first.type_name) == ("active", "ABCD", "Light sensor")
        assert first.part is not None
        assert (first.part.part, first.part.uid) == ("AA", b"AA......".hex())
        assert first.part.life == 3
        assert first.category == "sensor"  # by which the page knows what to draw
        assert first.next_beat_s is not None
        assert -0.2 <= first.next_beat_s <= 1.0
        assert [(port.port, port.publishes, port.topic) for port in first.ports] == [
            ("out", True, "HelloWorldTopic_1_to_2"),
            ("in", False, "HelloWorldTopic_3_to_1"),
        ]
        assert rig.views.slot("BB").name == second.name
        assert len(rig.views.beat_intervals("AA")) >= 2
        assert rig.views.beat_intervals("AA") == pytest.approx([1.0] * len(rig.views.beat_intervals("AA")), abs=0.2)

    show(tmp_path, scene)


def test_what_is_made_without_checks_is_what_the_models_take(tmp_path: Path) -> None:
    async def scene(rig: Rig) -> None:
        await rig.look(2.0)
        for card in rig.views.slots():
            assert SlotCard.model_validate(card.model_dump()) == card
            assert json.loads(card.model_dump_json()) == card.model_dump(mode="json")
            assert card.model_fields_set == set(SlotCard.model_fields)

    show(tmp_path, scene)


def shown(slot: ShownSlot) -> tuple[object, ...]:
    """Everything that a card shows of a slot."""
    part = slot.part
    return (
        (slot.name, slot.shown_number, slot.type_name, slot.state, slot.reason, slot.next_beat_s),
        (slot.spares, slot.simulated, slot.plugged, slot.faults, slot.type_differences, slot.main_port),
        None if part is None else (part.part, part.state, part.nature, part.life, part.beats, part.beat_age_s),
    )


def test_a_glance_shows_what_a_card_shows(tmp_path: Path) -> None:
    async def scene(rig: Rig) -> None:
        seen = set[str]()

        def compare() -> None:
            glances, waiting = rig.views.glances_and_waiting()
            assert [shown(one) for one in glances] == [shown(card) for card in rig.views.slots()]
            assert waiting == rig.views.waiting()
            seen.update(one.state for one in glances)
            seen.update(port.held for one in glances if (port := one.main_port) is not None)

        compare()
        await rig.look(3.0)
        compare()
        await rig.act(rig.session(Role.VIEWER), "stop")
        compare()
        await rig.look(3.0)
        compare()
        await rig.act(rig.session(Role.TEACHER), "go")
        rig.stage.pull("CC")
        for _ in range(12):
            await rig.look(0.5)
            compare()
        assert seen >= {"active", "lost", "", "gone"}

    show(tmp_path, scene)


def test_what_stop_leaves_a_port_at_is_named_with_who_says_so(tmp_path: Path) -> None:
    async def scene(rig: Rig) -> None:
        assert rig.views.safe_values("AA") == []
        assert [one.model_dump() for one in rig.views.safe_values("BB")] == [
            {"port": "in", "field": "message", "value": "rest", "unit": "", "origin": "blueprint", "stops_by": ""}
        ]

    place = 'name = "BB"\npart = "EFGH"\n'
    show(tmp_path, scene, (place, f'{place}safe.in = {{ message = "rest" }}\n'))


def test_an_empty_slot_and_a_part_that_is_pulled_out(tmp_path: Path) -> None:
    async def scene(rig: Rig) -> None:
        assert (rig.views.slot("CC").state, rig.views.slot("CC").part) == ("empty", None)
        rig.stage.pull("AA")
        await rig.look(6.0)
        card = rig.views.slot("AA")
        assert card.state == "lost"
        assert card.next_beat_s is None
        assert card.reason == "gone: closed"
        rig.stage.plug("AA", "ABCD")
        await rig.look(2.0)
        lane, *_ = rig.views.timeline()
        assert [span.state for span in lane.spans] == ["lost", "active"]
        assert lane.spans[-1].end_age_s == 0.0
        assert lane.spans[0].begin_age_s > lane.spans[0].end_age_s == lane.spans[1].begin_age_s

    show(tmp_path, scene, parts=("AA=ABCD",))


def test_what_an_actuator_does_is_not_shown_once_it_is_not_there(tmp_path: Path) -> None:
    async def scene(rig: Rig) -> None:
        rig.views.slot("BB")  # somebody looks: from now on samples are kept
        rig.stage.parts["AA"].publish("out", HelloWorld(index=7, message="now"))
        await rig.look(0.5)
        (heard,) = [port for port in rig.views.slot("BB").ports if port.port == "in"]
        assert (heard.held, done_fields(heard)) == ("", {"index": 7, "message": "now"})
        rig.stage.pull("BB")
        await rig.look(6.0)
        rig.stage.parts["AA"].publish("out", HelloWorld(index=8, message="to nobody"))
        await rig.look(0.5)
        (heard,) = [port for port in rig.views.slot("BB").ports if port.port == "in"]
        assert (heard.held, heard.fields["message"], done_fields(heard)) == ("gone", "to nobody", {})

    show(tmp_path, scene)


def test_what_is_not_there_is_refused_with_what_there_is(tmp_path: Path) -> None:
    async def scene(rig: Rig) -> None:
        with pytest.raises(NotThere, match="there is no slot 'XX'; there are AA, BB, CC"):
            rig.views.slot("XX")
        with pytest.raises(NotThere, match="no part of slot 'AA' is simulated here; those that are: BB"):
            rig.views.simulated("AA")
        assert rig.views.simulated("BB").readings == {"turned": 0}
        assert rig.views.slot("BB").plugged is True
        assert rig.views.slot("AA").plugged is None

    show(tmp_path, scene, bench=ToyBench("BB"))


def test_arrivals_are_the_parts_without_a_slot_and_the_ignored_come_last(tmp_path: Path) -> None:
    async def scene(rig: Rig) -> None:
        for name in ("spare", "later"):
            rig.stage.plug(name, "ABCD")
            await asyncio.sleep(1.0)
        assert [part.part for part in rig.views.arrivals()] == ["later", "spare"]
        await rig.stage.do.ignore("later", who="ann")
        assert [(part.part, part.ignored) for part in rig.views.arrivals()] == [("spare", False), ("later", True)]
        assert [part.part for part in rig.views.parts() if part.slot] == ["AA", "BB", "CC"]
        assert "spare" in rig.views.why("spare")[0]
        assert [lane.slot for lane in rig.views.timeline()] == ["AA", "BB", "CC", "spare", "later"]

    show(tmp_path, scene)


def test_free_slots_are_offered_those_first_that_fit(tmp_path: Path) -> None:
    async def scene(rig: Rig) -> None:
        assert [card.name for card in rig.views.free_slots("WXYZ")] == ["CC", "AA"]
        assert [card.name for card in rig.views.free_slots("DIAL")] == ["AA", "CC"]
        assert [card.name for card in rig.views.free_slots("unheard of")] == ["AA", "CC"]
        rig.stage.plug("AA", "ABCD")
        await asyncio.sleep(1.0)
        assert [card.name for card in rig.views.free_slots("WXYZ")] == ["CC"]

    show(tmp_path, scene, parts=("BB=EFGH",))


def test_an_adopted_stranger_carries_its_own_part_number(tmp_path: Path) -> None:
    async def scene(rig: Rig) -> None:
        await rig.stage.do.window(60, who="ann")
        await rig.stage.do.adopt("XX", "CC", who="ann")
        await rig.look(2.0)
        card = rig.views.slot("CC")
        assert (card.state, card.part_number) == ("active", "WXYZ")
        assert (card.shown_number, card.type_name) == ("NOPE", "")
        await rig.stage.do.adopt("DIAL", "BB", who="ann")
        await rig.look(2.0)
        card = rig.views.slot("BB")
        dial = rig.views.library.find("DIAL")
        assert dial is not None
        assert (card.part_number, card.shown_number, card.type_name) == ("EFGH", "DIAL", dial.name)
        rig.stage.pull_all()
        assert rig.views.slot("AA").shown_number == "ABCD"

    show(tmp_path, scene, parts=("AA=ABCD", "XX=NOPE", "DIAL=DIAL"))


def test_simulated_parts_without_a_slot_are_told_apart(tmp_path: Path) -> None:
    async def scene(rig: Rig) -> None:
        assert rig.views.spares() == ["DD"]
        assert rig.views.simulated("DD").plugged

    show(tmp_path, scene, bench=ToyBench("AA", "DD"))


def test_topics_have_ends_rates_and_the_latest_value(tmp_path: Path) -> None:
    async def scene(rig: Rig) -> None:
        part = rig.stage.parts["AA"]
        for index in range(20):
            part.publish("out", HelloWorld(index=index, message="<b>"))
            await rig.look(0.25)
        topic, *_ = rig.views.topics()
        assert (topic.publishers, topic.subscribers) == (["AA.out"], ["BB.in"])
        assert topic.count == 20
        assert topic.rate_hz == pytest.approx(4.0, rel=0.1)
        assert topic.fields == {"index": 19, "message": "<b>"}
        (told,) = [port for port in rig.views.slot("BB").ports if port.port == "in"]
        assert (told.count, told.fields) == (20, topic.fields)
        assert rig.views.live.series(topic.topic, "index")[-1][1] == 19.0

    show(tmp_path, scene)


def test_the_bus_is_counted_and_its_frames_are_found(tmp_path: Path) -> None:
    async def scene(rig: Rig) -> None:
        loop = asyncio.get_running_loop()
        assert rig.views.bus().watched is False
        for _ in range(2000):
            rig.frames.tap(loop.time(), "x", Frame(0x123))
        await asyncio.sleep(2.0)
        bus = rig.views.bus()
        assert bus.frames == 2000
        assert bus.frames_per_second == pytest.approx(1000, rel=0.01)
        lines = rig.views.frame_lines(1990, 5)
        assert [line.number for line in lines] == [1996, 1997, 1998, 1999, 2000]
        assert lines[0].age_s == 2.0
        assert rig.views.frame_line(1996) == lines[0]
        assert rig.views.frame_line(2001) is None

    show(tmp_path, scene)


def test_the_library_is_searched_by_all_words(tmp_path: Path) -> None:
    async def scene(rig: Rig) -> None:
        everything = rig.views.types()
        assert [line.name for line in everything] == sorted(line.name for line in everything)
        assert [line.number for line in rig.views.types("DIAL")] == ["DIAL"]
        servos = rig.views.types("SERVO")
        metal = rig.views.types("metal servo")
        assert "MG90S" in [line.number for line in metal]
        assert len(metal) < len(servos) < len(everything)
        assert {line.category for line in servos} == {"actuator"}
        assert rig.views.types("no such thing") == []

    show(tmp_path, scene, AA_IS_A_DIAL, parts=())


def test_a_card_shows_what_a_person_says_to_a_port_that_they_drive_by_hand(tmp_path: Path) -> None:
    async def scene(rig: Rig) -> None:
        await rig.stage.do.publish("BB.in", ["7", "by hand"], who="ann")
        (port,) = [port for port in rig.views.slot("BB").ports if port.port == "in"]
        assert (port.held, port.stale, port.fields) == ("by hand", False, {"index": 7, "message": "by hand"})
        await rig.stage.do.let_go("BB.in", who="ann")
        (port,) = [port for port in rig.views.slot("BB").ports if port.port == "in"]
        assert port.held == ""

    show(tmp_path, scene)
