"""Whether the programs of parts and the library mean the same by a message type. Pure.

A part tells for each of its ports the hash of the type that its program has (`TypeMessage`). If the library's hash is
another one, the part is asked for its fields, once for each port and hash; then journal, part and people learn
which field is the first that differs. A part that tells no hash (of the thesis, stock, written in C) is not compared.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from msbot.part.join.pnp_messages import MOST_BINDINGS, OF_REPLY, Notice, NoticeKind
from msbot.part.messages.type_hash import (
    NO_FUNCTION,
    Fields,
    FieldsOf,
    first_difference,
    hash_words,
    read_fields,
    type_hash,
)
from msbot.pnp.inventory_record import InventoryRecord
from msbot.pnp.model import TypeDifference
from msbot.pnp.state_changes import StateChanges
from msbot_agent.text.sentence import Sentence, said
from msbot_xrce.counting import Tally

NOT_KNOWN = 255
"""`Notice.detail`: which field differs is not known."""
MOST_NOTES = 20
"""Lines of the journal about this in one session of a part."""
LONGEST_NAME = 128
"""Characters of a field's kind and name that are shown."""


class TypeAgreement:
    """See the module's docstring.

    Args:
        changes: where notes are made.
        dropped: counts what is not taken.
    """

    def __init__(self, changes: StateChanges, dropped: Tally) -> None:
        self.library_fields: FieldsOf = lambda _: None
        """Finds the fields of a type of the library, also of those inside others; set by who has a library."""
        self._changes = changes
        self._dropped = dropped

    def differences(self, record: InventoryRecord) -> list[TypeDifference]:
        """Where a part's program and the library of today mean different messages, at the ports that it has now."""
        if not record.is_registered or record.configuration is None or not record.type_differences:
            return []
        bound = {(one.port, name) for one in record.configuration.bindings for name in one.messages}
        return [
            one
            for one in record.type_differences.values()
            if (one.port, one.type_name) in bound and self._library_hash(one.type_name) not in (None, one.theirs)
        ]

    def _library_hash(self, type_name: str) -> bytes | None:
        fields = self.library_fields(type_name)
        return None if fields is None else type_hash(type_name, fields, self.library_fields)

    def receive_hash(self, record: InventoryRecord, place: int, octets: bytes, now: float) -> Notice | None:
        """A part tells the hash of a port's type; the answer, if the library's is another one."""
        configuration = record.configuration
        bindings = () if configuration is None else configuration.bindings
        index, which = place & ~OF_REPLY, bool(place & OF_REPLY)
        binding = bindings[index] if index < min(len(bindings), MOST_BINDINGS) else None
        if configuration is None or binding is None or which >= len(binding.messages):
            self._dropped.count("hash of a type for a port that is not bound")
            return None
        name = binding.messages[which]
        expected = self._library_hash(name)
        if expected is None:
            return None
        known = record.type_differences.get((binding.port, which))
        if octets == expected:
            record.type_differences.pop((binding.port, which), None)
            return None
        if octets == NO_FUNCTION:
            if known is None or known.theirs != octets:
                found = TypeDifference(binding.port, name, octets, expected, NOT_KNOWN)
                record.type_differences[binding.port, which] = found
                self._note(record, now, found)
                self._changes.publish()
            return None
        if known is not None and (known.theirs, known.ours) == (octets, expected):
            return _notice(configuration.version, place, known.detail) if known.detail else None
        record.type_differences[binding.port, which] = TypeDifference(binding.port, name, octets, expected)
        return _notice(configuration.version, place, 0)

    def fields_told(self, record: InventoryRecord, text: str, now: float) -> list[Notice]:
        """A part tells the fields of its messages; answers for the ports whose types differ."""
        theirs = read_fields(text)
        configuration = record.configuration
        answers = []
        if configuration is None:
            return []
        bound = [
            (place, one.port, which) for place, one in enumerate(configuration.bindings) for which in (False, True)
        ]
        for place, port, which in bound:
            difference = record.type_differences.get((port, which))
            if difference is None or difference.detail:
                continue
            found = self._compared(difference, theirs)
            record.type_differences[port, which] = found
            self._note(record, now, found)
            answers.append(_notice(configuration.version, place | OF_REPLY * which, found.detail))
        self._changes.publish()
        return answers

    def _note(self, record: InventoryRecord, now: float, found: TypeDifference) -> None:
        if record.type_notes < MOST_NOTES:
            record.type_notes += 1
            self._changes.note(record, now, difference_sentence(found))

    def _compared(self, difference: TypeDifference, theirs: Mapping[str, Fields]) -> TypeDifference:
        names = (name for name, fields in theirs.items() if type_hash(name, fields, theirs.get) == difference.theirs)
        their_type = next(names, difference.type_name)
        if their_type != difference.type_name:
            return replace(difference, detail=NOT_KNOWN, their_type=their_type[:LONGEST_NAME])
        ours = self.library_fields(difference.type_name) or ()
        told = theirs.get(difference.type_name, ())
        found = first_difference(told, ours, theirs.get, self.library_fields) if told else None
        return TypeDifference(
            difference.port,
            difference.type_name,
            difference.theirs,
            difference.ours,
            NOT_KNOWN if found is None else min(found.place + 1, NOT_KNOWN - 1),
            "" if found is None else found.theirs[:LONGEST_NAME],
            "" if found is None else found.ours[:LONGEST_NAME],
        )


def difference_sentence(difference: TypeDifference) -> Sentence:
    """What differs at a port, for people."""
    if difference.theirs == NO_FUNCTION:
        return said(
            'port {port}: the part\'s program has no function that serves it: @part.serves("{port}", ...) names one',
            port=difference.port,
        )
    if difference.their_type:
        return said(
            "port {port}: the part's program has {theirs} there, the library {type}",
            port=difference.port,
            theirs=difference.their_type,
            type=difference.type_name,
        )
    known = {
        "port": difference.port,
        "type": difference.type_name,
        "theirs": hash_words(difference.theirs),
        "ours": hash_words(difference.ours),
    }
    if difference.detail in (0, NOT_KNOWN):
        return said(
            "port {port}: {type} of the part's program ({theirs}) is not that of the library ({ours})",
            **known,
        )
    return said(
        "port {port}: {type} of the part's program ({theirs}) is not that of the library ({ours}): "
        "field {place} is {their_field} there, and {our_field} in the library",
        **known,
        place=difference.detail,
        their_field=difference.their_field or said("missing"),
        our_field=difference.our_field or said("missing"),
    )


def _notice(version: int, place: int, detail: int) -> Notice:
    return Notice(number=version & 0xFFFFFFFF, binding=place, kind=NoticeKind.TYPE_DIFFERS, detail=detail)
