"""Any interleaving of sessions, claims, beats, time and changes by people leaves the inventory sound."""

from __future__ import annotations

from itertools import pairwise

import pytest
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, precondition, rule

from msbot.config import Slot
from msbot.pnp import FAST_TIMING, THESIS_TIMING, LifeTiming, PartState
from msbot.pnp.life_status import TRANSITIONS
from msbot.pnp.slot_assignment import PLACEABLE
from msbot_xrce.errors import LocalProtocolError
from tests.effort import tries
from tests.pnp.robot import Rig, sample_store

keys = st.integers(1, 5)
numbers = st.sampled_from(["ABCD", "ABCD", "EFGH", "NOPE"])
names = st.sampled_from(["", "AA", "AA2"])
serials = st.integers(0, 4)


class InventoryMachine(RuleBasedStateMachine):
    """Five sessions, five UIDs (0 = none), four slots of which two take the same number."""

    rig: Rig

    @initialize(timing=st.sampled_from([THESIS_TIMING, FAST_TIMING]))
    def start(self, timing: LifeTiming) -> None:
        self.rig = Rig(sample_store(Slot("AA2", "ABCD")), timing=timing)
        self.open: set[int] = set()
        self.beaten_at: dict[int, float] = {}

    @rule(key=keys, quiet=st.booleans())
    def join(self, key: int, quiet: bool) -> None:
        self.open.add(key)
        self.rig.join(key, quiet=quiet)

    @rule(key=keys)
    def ask_for_the_profile(self, key: int) -> None:
        self.rig.inventory.profile_asked(key, self.rig.now)

    @rule(key=keys, politely=st.booleans())
    def leave(self, key: int, politely: bool) -> None:
        self.open.discard(key)
        self.rig.leave(key, politely=politely)

    @precondition(lambda self: self.open)
    @rule(
        key=keys,
        number=numbers,
        name=names,
        serial=serials,
        nonce=st.integers(0, 1),
        compat=st.booleans(),
        data=st.data(),
    )
    def claim(
        self, key: int, number: str, name: str, serial: int, nonce: int, compat: bool, data: st.DataObject
    ) -> None:
        key = data.draw(st.sampled_from(sorted(self.open)), label="session")
        layout = "compat" if compat else "compact"
        verdict = self.rig.claim(key, number, name=name, serial=serial, nonce=nonce, layout=layout)
        if verdict.lease:
            assert verdict.refusal is None
            assert self.rig.state(key).is_registered
            self.beaten_at[key] = self.rig.now

    @rule(key=keys)
    def beat(self, key: int) -> None:
        if self.rig.beat(key):
            assert self.rig.state(key) is PartState.ACTIVE
            self.beaten_at[key] = self.rig.now

    @rule(key=keys, other=keys)
    def beat_with_somebody_elses_lease(self, key: int, other: int) -> None:
        if key != other and key in self.rig.leases and self.rig.leases[key] != self.rig.leases.get(other):
            assert self.rig.inventory.beat(self.rig.leases[key], other, self.rig.now) == 0

    @rule(seconds=st.sampled_from([0.1, 0.5, 1.0, 2.0, 7.0]))
    def wait(self, seconds: float) -> None:
        self.rig.run(seconds)

    @rule(seconds=st.sampled_from([1.0, 10.0]))
    def be_held_up(self, seconds: float) -> None:
        self.rig.now += seconds
        self.rig.inventory.handle_timer(self.rig.now)

    @rule(number=st.sampled_from(["ABCD", "EFGH"]), blocked=st.booleans())
    def block(self, number: str, blocked: bool) -> None:
        self.rig.store.blocks = {number: "a person said so"} if blocked else {}

    @rule(numbers=st.sets(st.sampled_from(["ABCD", "EFGH"])))
    def block_and_put_out(self, numbers: set[str]) -> None:
        self.rig.store.blocks = dict.fromkeys(numbers, "a person said so")
        self.rig.inventory.blocks_changed(self.rig.now)

    @rule(data=st.data())
    def move(self, data: st.DataObject) -> None:
        placeable = [
            part.client_key
            for part in self.rig.inventory.view(self.rig.now)
            if part.client_key in self.open and part.state in PLACEABLE
        ]
        if not placeable:
            return
        slots = [slot.name for slot in self.rig.store.slot_list]
        keys = data.draw(st.lists(st.sampled_from(placeable), min_size=1, max_size=2, unique=True), label="parts")
        wanted = data.draw(st.permutations([*slots, None, None]), label="slots")
        moves = dict(zip(keys, wanted, strict=False))
        if self.has_twin(moves):
            with pytest.raises(LocalProtocolError):
                self.rig.inventory.rearrange(moves, self.rig.now, "a person moved them")
            return
        self.rig.inventory.rearrange(moves, self.rig.now, "a person moved them")
        for key, slot in moves.items():
            if slot is not None:
                assert self.rig.part(key).slot == slot
                assert self.rig.state(key).is_registered

    def has_twin(self, moves: dict[int, str | None]) -> bool:
        """Whether one UID would be in two slots."""
        view = [part for part in self.rig.inventory.view(self.rig.now) if not part.state.is_over]
        there = {part.client_key: part for part in view}
        holders = {record.client_key: slot for slot, record in self.rig.inventory._index.holders.items()}
        after = {key: slot for key, slot in holders.items() if slot not in moves.values()} | moves
        uids = [there[key].uid or key for key, slot in after.items() if slot is not None]
        return len(set(uids)) < len(uids)

    @rule(there=st.booleans())
    def change_the_slots(self, there: bool) -> None:
        slots = [slot for slot in self.rig.store.slot_list if slot.name != "AA2"]
        self.rig.store.slot_list = [*slots, Slot("AA2", "ABCD")] if there else slots
        self.rig.inventory.reload(self.rig.now)

    @rule(key=keys)
    def ask_why(self, key: int) -> None:
        assert self.rig.inventory.why(f"{key:08x}", self.rig.now)

    @invariant()
    def a_slot_has_one_part_and_an_active_part_has_a_slot_and_rights(self) -> None:
        registered = [part for part in self.rig.inventory.view(self.rig.now) if part.state.is_registered]
        slots = [part.slot for part in registered]
        assert None not in slots
        assert len(set(slots)) == len(slots)
        for part in registered:
            configuration = self.rig.inventory.configuration_of(part.client_key)
            assert configuration is not None
            assert configuration.slot == part.slot
            assert part.life > 0

    @invariant()
    def who_is_not_registered_has_no_rights(self) -> None:
        registered = {p.client_key for p in self.rig.inventory.view(self.rig.now) if p.state.is_registered}
        assert registered <= self.open
        for key in range(1, 6):
            assert (self.rig.inventory.configuration_of(key) is not None) == (key in registered)

    @invariant()
    def life_is_between_0_and_3_and_0_for_who_is_gone(self) -> None:
        for part in self.rig.inventory.view(self.rig.now):
            assert 0 <= part.life <= 3
            assert not (part.state.is_over and part.life)

    @invariant()
    def no_uid_is_registered_twice(self) -> None:
        view = self.rig.inventory.view(self.rig.now)
        uids = [part.uid for part in view if part.state.is_registered and part.uid]
        assert len(set(uids)) == len(uids)

    @invariant()
    def every_open_session_is_shown_at_most_once(self) -> None:
        shown = [part.client_key for part in self.rig.inventory.view(self.rig.now) if not part.state.is_over]
        assert len(set(shown)) == len(shown)
        assert set(shown) <= self.open

    @invariant()
    def the_index_of_free_slots_is_true(self) -> None:
        inventory = self.rig.inventory
        free = {name for slots in inventory._matcher._free.values() for name in slots}
        assert free == {slot.name for slot in self.rig.store.slot_list} - set(inventory._index.holders)

    @invariant()
    def events_are_told_in_order_and_by_the_table(self) -> None:
        events = self.rig.events
        assert events == self.rig.store.events
        assert all((event.from_state, event.to_state) in TRANSITIONS for event in events)
        assert all(event.reason for event in events)
        assert all(first.at <= second.at for first, second in pairwise(events))

    @invariant()
    def rights_were_told_whenever_they_changed(self) -> None:
        changes = [
            event.client_key
            for event in self.rig.events
            if (event.from_state is not None and event.from_state.is_registered) != event.to_state.is_registered
        ]
        assert self.rig.rights == changes


InventoryMachine.TestCase.settings = settings(max_examples=tries(60, 2000), stateful_step_count=40, deadline=None)
TestInventory = InventoryMachine.TestCase
