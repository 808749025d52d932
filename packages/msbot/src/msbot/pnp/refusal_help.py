"""What a part that is not let in is told besides the reason's number: who has its slot, and what to type. Pure.

Only where refusals are explained, and never what only teachers see, as UIDs and addresses.
"""

from __future__ import annotations

import shlex
from collections.abc import Mapping

from msbot.part.join.pnp_messages import HELP_SETTING, ConfigurationMessage, Setting
from msbot.part.join.refusal import Refusal
from msbot.pnp.inventory_record import InventoryRecord
from msbot.pnp.slot_matching import Matcher
from msbot_agent.text.sentence import Sentence, joined, said
from msbot_xrce.errors import RegistryError

LONGEST = 400
"""Characters of what is told."""
MOST_SLOTS = 3
"""Slots that are named."""


def refusal_help(record: InventoryRecord, matcher: Matcher, holders: Mapping[str, InventoryRecord]) -> Sentence | None:
    """What helps a part that has been refused or stands by; None: nothing is known that helps."""
    claim = record.claim
    if claim is None or record.is_registered:
        return None
    part, number = shlex.quote(record.name), claim.part_number
    match record.refusal:
        case Refusal.NO_SLOT:
            return _without_slot(record, part, matcher, holders)
        case Refusal.WRONG_ROBOT:
            return said(
                "this robot has no slot for a {number}: `msbot slot add NAME {quoted}` makes one",
                number=number,
                quoted=shlex.quote(number),
            )
        case Refusal.BLOCKED:
            return said("{reason}; `msbot unblock {part}` lets it in again", reason=record.reason, part=part)
        case Refusal.DUPLICATE if record.contest is not None:
            rival = record.contest.rival
            return said("{rival} in slot {slot} has the same UID", rival=rival.name, slot=rival.slot or "-")
    return None


def _without_slot(
    record: InventoryRecord, part: str, matcher: Matcher, holders: Mapping[str, InventoryRecord]
) -> Sentence | None:
    assert record.claim is not None
    try:
        free, fitting = matcher.free_slots(record.claim.part_number), matcher.slots_for(record.claim.part_number)
    except RegistryError:
        return None  # the reason of the refusal says it soon
    free = [slot for slot in fitting if slot in free]  # in the robot's order
    if free:
        return said(
            "{reason}: `msbot adopt {part} --slot SLOT` puts it into one of {slots}",
            reason=record.reason,
            part=part,
            slots=", ".join(free[:MOST_SLOTS]),
        )
    held = [
        said("slot {slot} has {holder}", slot=slot, holder=holders[slot].name) for slot in fitting if slot in holders
    ]
    if not held:
        return None
    return said(
        "{held}; this part gets a slot when one is free, or by `msbot swap {slot} --to {part}`",
        held=joined(", ", held[:MOST_SLOTS]),
        slot=shlex.quote(fitting[0]),
        part=part,
    )


def help_message(words: str) -> ConfigurationMessage:
    """The same on the wire: in a configuration of no slot, which a part that is not let in ignores if it is older."""
    setting = Setting(name=HELP_SETTING, value=words[:LONGEST])
    return ConfigurationMessage(version=0, slot="", bindings=[], settings=[setting])
