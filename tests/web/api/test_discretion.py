"""Client keys and addresses of parts are shown to teachers only, in whatever text they stand (issue 11, point 14)."""

from __future__ import annotations

from dataclasses import replace

import pytest

from msbot.operations.rights import Role
from msbot.registry import JournalEntry
from msbot.runtime.sentence import from_json, to_json
from msbot.web.access.sessions import Session
from msbot.web.api.session import journal_for, parts_for, words_for
from msbot.web.cards import part_line
from msbot.web.records import journal_line
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
    said = "\n".join(texts(story(), Session("ann", role, 0.0, 0.0)))
    assert [address for address in ADDRESSES.values() if address in said] == []
    assert "another part with the same UID is active" in said
    assert "newcomer" in said


def test_a_teacher_reads_them() -> None:
    said = "\n".join(texts(story(), Session("tom", Role.TEACHER, 0.0, 0.0)))
    assert [address for address in ADDRESSES.values() if address not in said] == []
