"""Changes are journalled at once and told in order, after everything is consistent."""

from __future__ import annotations

from random import Random

from msbot.pnp import THESIS_TIMING, Matcher, PartEvent, PartState, Refusal
from msbot.pnp.inventory_index import InventoryIndex, PartSession
from msbot.pnp.state_changes import HandControl, StateChanges
from tests.pnp.robot import sample_store


class Scene:
    """State changes with all they need, and one session."""

    def __init__(self) -> None:
        self.store = sample_store()
        self.index = InventoryIndex(Random(1), THESIS_TIMING, keep_ended=4)
        self.matcher = Matcher(self.store)
        self.changes = StateChanges(self.store, self.index, self.matcher, HandControl())
        self.session = self.index.sessions[1] = PartSession(1, "peer 1", 0.0)
        self.told: list[str] = []
        self.changes.event_handlers.append(self.hear)
        self.changes.rights_handlers.append(lambda key: self.told.append(f"rights of {key}"))

    def hear(self, event: PartEvent) -> None:
        self.told.append(event.to_state.value)


def test_an_event_is_journalled_at_once_and_told_when_published() -> None:
    scene = Scene()
    scene.changes.appear(scene.session, 0.0)
    assert [event.to_state for event in scene.store.events] == [PartState.NEW]
    assert scene.told == []
    scene.changes.publish()
    scene.changes.publish()
    assert scene.told == ["new"]


def test_rights_are_told_before_events_and_only_when_they_change() -> None:
    scene = Scene()
    record = scene.changes.appear(scene.session, 0.0)
    for state in (PartState.CHECKING, PartState.ACTIVE, PartState.LATE, PartState.ACTIVE):
        scene.changes.move(record, state, 0.0, "test")
    scene.changes.publish()
    assert scene.told == ["rights of 1", "new", "checking", "active", "late", "active"]


def test_retiring_frees_the_slot_and_ends_life_and_lease() -> None:
    scene = Scene()
    record = scene.changes.appear(scene.session, 0.0)
    scene.changes.move(record, PartState.CHECKING, 0.0, "test")
    scene.matcher.take("AA")
    scene.index.grant(record, "AA")
    record.life.register(0.0)
    scene.changes.move(record, PartState.ACTIVE, 0.0, "test")
    scene.changes.retire(record, PartState.LEFT, 1.0, "goodbye")
    assert (record.lease, record.holds_slot, record.life.status, record.reason) == (0, False, 0, "goodbye")
    assert "AA" in scene.matcher._free["ABCD"]


def test_what_a_handler_does_is_told_after_what_it_was_told() -> None:
    scene = Scene()

    def answer(event: PartEvent) -> None:
        if event.to_state is PartState.NEW:
            record = scene.session.record
            assert record is not None
            scene.changes.move(record, PartState.CHECKING, 0.0, "at once")
            scene.changes.publish()

    scene.changes.event_handlers.insert(0, answer)
    scene.changes.appear(scene.session, 0.0)
    scene.changes.publish()
    assert scene.told == ["new", "checking"]


def test_what_is_told_later_comes_after_rights_and_events() -> None:
    scene = Scene()
    scene.changes.after_events(lambda: scene.told.append("later"))
    record = scene.changes.appear(scene.session, 0.0)
    scene.changes.move(record, PartState.CHECKING, 1.0, "claims")
    scene.changes.seat(record, scene.store.configuration("AA"), 2.0, "found")
    scene.changes.publish()
    assert scene.told == ["rights of 1", "new", "checking", "active", "later"]
    assert record.life.status == 3


def test_a_part_that_is_turned_away_has_no_slot_and_no_life() -> None:
    scene = Scene()
    record = scene.changes.appear(scene.session, 0.0)
    scene.changes.move(record, PartState.CHECKING, 1.0, "claims")
    scene.changes.seat(record, scene.store.configuration("AA"), 2.0, "found")
    scene.changes.vacate(record)
    assert scene.changes.freed == {"AA": record}
    scene.changes.turn_away(record, Refusal.NO_SLOT, 3.0, "a person took it out")
    assert (record.state, record.slot, record.life.status, record.lease) == (PartState.STANDBY, None, 0, 0)
