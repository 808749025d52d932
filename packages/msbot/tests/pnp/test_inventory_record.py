"""What a part tells about itself: `why` and names."""

from __future__ import annotations

from itertools import count

import pytest
from hypothesis import given
from hypothesis import strategies as st

from msbot.part.join.hardware_trouble import TROUBLE_ENDS, TROUBLE_PIECES
from msbot.part.join.refusal import Refusal
from msbot.pnp import THESIS_TIMING, PartState
from msbot.pnp.inventory_record import HISTORY, InventoryRecord, lasting
from msbot.pnp.model import SelfDescription
from tests.pnp.robot import Rig

AA = 0xAAAAAAAA


def test_why_tells_the_chain_of_rules_with_evidence() -> None:
    rig = Rig()
    rig.claim(AA, "ABCD", name="light", serial=0xA1)
    rig.now += 0.5
    lines = rig.inventory.why("light", rig.now)
    assert lines[0] == (
        "light (ABCD) is active since 0.5 s in slot AA, life 3, last beat less than 1 s ago: "
        "slot AA is the one free slot that fits"
    )
    assert "0.5 s ago: light: checking -> active in slot AA: slot AA is the one free slot that fits" in lines
    assert "  - library: ABCD: light sensor" in lines
    assert "  - same UID as before: never seen here" in lines


@pytest.mark.parametrize(
    ("seconds", "words"),
    [
        (-1.0, "0.0 s"),
        (0.04, "0.0 s"),
        (9.9, "9.9 s"),
        (9.95, "10 s"),
        (9.96, "10 s"),
        (119.0, "119 s"),
        (120.0, "2 min"),
        (7100.0, "118 min"),
        (7200.0, "2 h"),
        (172_000.0, "48 h"),
        (172_800.0, "2 days"),
        (1e7, "116 days"),
    ],
)
def test_a_time_is_as_exact_as_matters_after_so_long(seconds: float, words: str) -> None:
    assert lasting(seconds) == words


def test_of_a_healthy_part_the_life_status_stands_still_and_of_a_late_one_it_is_counted() -> None:
    rig = Rig()
    rig.claim(AA, "ABCD", name="light", serial=0xA1)
    for _ in range(10):  # beats of 1 s, ticks of 2 s: every second tick comes just before a beat
        rig.run(1.0)
        assert (rig.state(AA), rig.part(AA).life) == (PartState.ACTIVE, 3)
        assert "life 3" in rig.inventory.why("light", rig.now)[0]
        rig.beat(AA)
    rig.run(3.0)
    assert (rig.state(AA), rig.part(AA).life) == (PartState.LATE, 2)
    assert "life 2" in rig.inventory.why("light", rig.now)[0]


@pytest.mark.parametrize("word", ["LIGHT", "AA", "abcd", "00000000000000a1", "aaaaaaaa", "peer 2863311530"])
def test_why_knows_a_part_by_any_of_its_names(word: str) -> None:
    rig = Rig()
    rig.claim(AA, "ABCD", name="light", serial=0xA1)
    assert rig.inventory.why(word, rig.now)[0].startswith("light (ABCD)")


def test_why_of_somebody_unknown_lists_who_is_there() -> None:
    rig = Rig()
    assert rig.inventory.why("x", rig.now) == ["No part is known as 'x'. Parts seen: none yet."]
    rig.join(AA, "node 7")
    assert rig.inventory.why("x", rig.now) == ["No part is known as 'x'. Parts seen: node 7."]
    assert rig.inventory.why("node 7", rig.now)[0] == "node 7 is new since 0.0 s: a session was opened from node 7"


def test_a_name_cannot_steer_the_terminal_of_the_reader() -> None:
    rig = Rig()
    rig.claim(AA, "ABCD", name="\x1b[2Jevil" + "x" * 1000)
    part = rig.part(AA)
    assert part.local_name.startswith("?[2Jevil")
    assert len(part.local_name) == 255
    assert part.state is PartState.REFUSED


SAYS = SelfDescription("a lamp")


@pytest.mark.parametrize("state", [None, *PartState])
@pytest.mark.parametrize("refusal", [None, *Refusal])
def test_what_a_table_shows_of_a_part_in_any_state_and_however_it_was_refused(
    state: PartState | None, refusal: Refusal | None
) -> None:
    record = InventoryRecord(7, "peer", THESIS_TIMING, 5.0)
    record.state, record.refusal, record.says = state, refusal, SAYS
    shown = record.info(7.5, None)
    has_a_place = state in (PartState.ACTIVE, PartState.LATE)
    assert shown.state is (state or PartState.NEW)
    assert shown.refusal is (None if has_a_place else refusal)
    assert shown.says is (SAYS if refusal is Refusal.UNKNOWN_PART and not has_a_place else None)
    assert (shown.state_age_s, shown.beat_age_s, shown.plug_in_to_active_ms) == (2.5, None, None)
    record.life.refresh(7.0)
    record.plug_in_to_active_s = 0.25
    shown = record.info(7.5, None)
    assert (shown.beat_age_s, shown.plug_in_to_active_ms) == (0.5, 250.0)
    assert record.info(4.0, None).state_age_s == 0.0, "a clock that was set back"


def test_why_names_other_devices_and_bad_seals_only_if_there_were_any() -> None:
    record = InventoryRecord(7, "peer", THESIS_TIMING, 5.0)
    record.move(PartState.NEW, 5.0, "plugged in")
    assert record.sentences(5.0) == ["peer is new since 0.0 s: plugged in", "0.0 s ago: peer: new: plugged in"]
    for address in ("peer 8", "peer 9", "peer 8"):
        record.note_duplicate(address)
    record.refused_samples = 3
    assert record.sentences(5.0)[1:3] == [
        "The same UID was shown, and refused, at peer 8, peer 9.",
        "Samples in its name without a good seal, refused: 3.",
    ]


@pytest.mark.parametrize(("at", "words"), [(5.9, "less than 1 s ago"), (6.0, "1.0 s ago"), (6.5, "1.5 s ago")])
def test_a_beat_that_is_due_has_an_age(at: float, words: str) -> None:
    record = InventoryRecord(7, "peer", THESIS_TIMING, 5.0)
    record.slot, record.holds_slot = "AA", True
    record.life.register(5.0)
    assert f"in slot AA, life 3, last beat {words}: " in record.sentences(at)[0]


@pytest.mark.parametrize(("had", "has", "then"), [("AA", None, "AA"), ("AA", "BB", "BB"), (None, "BB", "BB")])
def test_a_later_session_of_a_part_goes_on_where_the_earlier_one_ended(
    had: str | None, has: str | None, then: str | None
) -> None:
    old, new = (InventoryRecord(key, "peer", THESIS_TIMING, 5.0) for key in (1, 2))
    for record, slot in ((old, had), (new, has)):
        record.slot, record.refused_claims, record.refused_samples = slot, 2, 3
        record.move(PartState.NEW, 5.0, f"session {record.client_key}")
    new.succeed(old)
    assert (new.slot, new.refused_claims, new.refused_samples) == (then, 4, 6)
    assert [event.reason for event in new.history] == ["session 1", "session 2"]
    for number in range(HISTORY):
        new.note(6.0, f"note {number}")
    assert [event.reason for event in new.history] == [f"note {number}" for number in range(HISTORY)]


@given(st.lists(st.tuples(st.integers(0, 2), st.integers(1, TROUBLE_PIECES - 1), st.booleans()), max_size=5))
def test_pieces_of_a_sentence_count_in_order_from_the_first(runs: list[tuple[int, int, bool]]) -> None:
    record = InventoryRecord(7, "peer", THESIS_TIMING, 5.0)
    pieces: list[str] = []
    sentence = ""
    letters = count()
    for first, many, ends in runs:
        for place in range(first, first + many):
            is_last = ends and place == first + many - 1
            piece = f"{next(letters):12}"
            record.take_piece(place | (TROUBLE_ENDS if is_last else 0), piece.encode())
            if place == 0:
                pieces = []
            if place != len(pieces) or place >= TROUBLE_PIECES:
                pieces = []
                continue
            pieces.append(piece)
            if is_last:
                sentence = "".join(pieces)
            assert record.trouble == sentence
    assert record.trouble == sentence


@pytest.mark.parametrize("trouble", ["", "no sensor"])
@pytest.mark.parametrize("state", [PartState.REFUSED, PartState.STANDBY, PartState.ACTIVE])
def test_why_a_part_has_gone_is_told_with_what_explains_it(state: PartState, trouble: str) -> None:
    record = InventoryRecord(7, "peer", THESIS_TIMING, 5.0)
    record.state, record.reason, record.trouble = state, "no slot fits", trouble
    because = "; it was refused: no slot fits" if state is PartState.REFUSED else ""
    assert record.with_what_was_said("gone") == "gone" + (f"; it said: {trouble}" if trouble else because)
