"""Client keys, addresses and UIDs of parts are shown to teachers only, in whatever text they stand."""

from __future__ import annotations

from dataclasses import replace

import pytest

from msbot.operations.rights import Role
from msbot.registry import JournalEntry
from msbot_agent.text.sentence import from_json, said, to_json
from msbot_web.access.sessions import Session
from msbot_web.api.dependencies import done_for, edits_for, journal_for, parts_for, words_for
from msbot_web.api.uid_redactor import UidRedactor
from msbot_web.models.bus_models import FrameLine
from msbot_web.models.robot_models import ChangeResult, EditLine
from msbot_web.slot_cards import part_line
from msbot_web.stored_data import journal_line
from tests.pnp.robot import Rig

ADDRESSES = {1: "192.0.2.1:40001", 2: "192.0.2.2:40002", 3: "192.0.2.3:40003", 4: "192.0.2.4:40004"}


def story() -> Rig:
    """A part, its twin that is refused, its restart elsewhere, and somebody who has not said a word."""
    rig = Rig()
    for key, address in ADDRESSES.items():
        rig.join(key, address)
    rig.claim(1, "ABCD", serial=7)
    rig.claim(2, "ABCD", serial=7)
    rig.run(2.0, 1)
    rig.claim(2, "ABCD", serial=7)
    rig.claim(3, "ABCD", serial=7)
    rig.run(2.0)
    rig.claim(3, "ABCD", serial=7)
    assert rig.part(3).slot == "AA"
    return rig


def texts(rig: Rig, session: Session) -> list[str]:
    """All that is said of parts, as pages and API say it; what the journal keeps has been through the database."""
    infos = rig.inventory.view(rig.now)
    why = [line for info in infos for line in rig.inventory.why(info.uid.hex() or info.address, rig.now)]
    why += rig.inventory.why("nobody", rig.now)
    found = [words_for(session, line) for line in why]
    found += [
        str(part.model_dump()) for part in parts_for(session, [part_line(info, is_ignored=False) for info in infos])
    ]
    kept = [
        replace(
            event,
            reason=from_json(to_json(event.reason)),
            evidence=tuple((from_json(to_json(rule)), from_json(to_json(fact))) for rule, fact in event.evidence),
        )
        for event in rig.events
    ]
    lines = [journal_line(JournalEntry(number, "robot", 0, event)) for number, event in enumerate(kept)]
    return found + [str(line.model_dump()) for line in journal_for(session, lines)]


@pytest.mark.parametrize("role", [Role.VIEWER, Role.STUDENT])
def test_students_read_no_address_anywhere(role: Role) -> None:
    told = "\n".join(texts(story(), Session("ann", role, 0.0, 0.0)))
    assert [address for address in ADDRESSES.values() if address in told] == []
    assert [uid for uid in uids() if uid in told] == []
    assert "another part with the same UID is active" in told
    assert "newcomer" in told


def test_a_teacher_reads_them() -> None:
    told = "\n".join(texts(story(), Session("tom", Role.TEACHER, 0.0, 0.0)))
    assert [address for address in ADDRESSES.values() if address not in told] == []
    assert uids()
    assert [uid for uid in uids() if uid not in told] == []


def uids() -> set[str]:
    return {info.uid.hex() for info in story().inventory.view(0.0) if info.uid}


UID = "00112233445566aa"


@pytest.mark.parametrize(
    "notation",
    ["101#00112233445566AA", "101#0311223344", "103##1FF5566AA0000", "18DA00F1#AA00FF112233", "101#3344556600000000"],
)
def test_a_frame_with_a_piece_of_a_uid_is_shown_without_its_data_to_all_but_teachers(notation: str) -> None:
    row = FrameLine(
        number=1,
        age_s=0.0,
        sender="x",
        text=f"  {notation.partition('#')[0]}  [8] {notation[4:]}",
        node=1,
        plain=[],
        about=["a claim"],
        words=[f"claim with UID {UID}"],
        notation=notation,
    )
    other = row.model_copy(update={"notation": "101#C010000000000000", "text": "  101  [2] C0 10", "words": [UID]})
    hidden, shown = UidRedactor([UID, "0000000000000001", ""]).frames([row, other])
    assert (hidden.text.split()[1:], hidden.notation, hidden.words) == (["…"], "", [])
    assert (shown.text, shown.notation, shown.words) == (other.text, other.notation, ["…"])
    assert UidRedactor([]).frames([row])[0].text == row.text
    log = f"(1.000000) can0 {notation}\n(1.1) can0 101#C010\n"
    assert UidRedactor([UID]).lines(log) == "(1.1) can0 101#C010\n"


def test_what_people_have_changed_and_what_went_wrong_names_no_uid_to_students() -> None:
    words = said("{part} ({number}, {uid})", part="ABCD", number="ABCD", uid=said("UID {uid}", uid=UID))
    line = EditLine(number=1, at_ms=1, who="tom", kind="block", slot="", words=words, undone=False, undoable=True)
    for role in Role:
        session = Session("ann", role, 0.0, 0.0)
        found = [edits_for(session, [line])[0].words, done_for(session, ChangeResult(words=words)).words]
        assert [UID in text for text in found] == [role >= Role.TEACHER] * 2
