"""Parts that say what they are: who is asked, and whose answer is taken (docs/decisions/0007). Pure.

A part that was turned away because the library does not know its number is asked, in a robot with keys after its proof.
Its answer changes nothing: it is kept with the part until somebody else has checked it, and a person has adopted it. A
part that is in the robot is asked when a person adopts it anew; its answer goes to whoever has asked.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from msbot.part.join.pnp_messages import MOST_DESCRIPTION
from msbot.part.join.refusal import Refusal
from msbot.pnp.inventory_index import InventoryIndex
from msbot.pnp.inventory_record import InventoryRecord
from msbot.pnp.model import SelfDescription
from msbot.pnp.state_changes import StateChanges
from msbot_agent.text.sentence import said
from msbot_xrce.counting import Tally

ASK_TIMES = 3
"""How often a part is asked, in case a question or its answer is lost; most parts know no answer."""

Checker = Callable[[int, str, SelfDescription], None]
"""Called with the client key, the part number and what the part says, to check it and then call `checked`."""


class SelfDescriptions:
    """See the module's docstring.

    Args:
        index: sessions and parts.
        changes: where notes are made.
        dropped: counts what is not taken.
    """

    def __init__(self, index: InventoryIndex, changes: StateChanges, dropped: Tally) -> None:
        self._index = index
        self._changes = changes
        self._dropped = dropped
        self._checkers: list[Checker] = []

    def on_described(self, checker: Checker) -> None:
        """Have what parts say of themselves checked."""
        self._checkers.append(checker)

    def ask(self, client_key: int) -> bool:
        """Whether to ask the part behind a session now; counts as asked."""
        record = self._record(client_key)
        if record is None or record.is_registered or record.refusal is not Refusal.UNKNOWN_PART:
            return False
        if record.says is not None or record.asked_what >= ASK_TIMES:
            return False
        record.asked_what += 1
        return True

    def ask_again(self, client_key: int) -> bool:
        """Take what a part that is in the robot says next, because a person adopts it anew; False: it is not there."""
        record = self._record(client_key)
        if record is None or not record.is_registered:
            return False
        record.says_again = True
        return True

    def receive_description(self, client_key: int, text: str, now: float) -> None:
        """A part says what it is: taken once, and only if it was asked."""
        record = self._record(client_key)
        if record is None or record.claim is None or record.state is None:
            self._dropped.count("description of a client that has not claimed")
        elif record.says_again:
            self._said_again(client_key, record, SelfDescription(text))
        elif record.says is None and record.refusal is Refusal.UNKNOWN_PART and record.asked_what:
            record.says = SelfDescription(text)
            for checker in self._checkers:
                self._changes.after_events(partial(checker, client_key, record.claim.part_number, record.says))
        else:
            self._dropped.count("description that nobody asked for")
            if record.refusal is not Refusal.UNKNOWN_PART and not record.spoke_unasked:
                record.spoke_unasked = True  # noted once
                words = said("it says what it is, and was not asked: the library's entry of its number counts")
                self._changes.note(record, now, words)
        self._changes.publish()

    def unreadable(self, client_key: int, size: int, fault: str, now: float) -> None:
        """A request cannot be read; from a part that was asked what it is, that is its answer, and it is refused.

        Args:
            client_key: the session that it came through.
            size: its octets.
            fault: what is wrong with them.
            now: the present time.
        """
        record = self._record(client_key)
        is_asked = record is not None and record.says is None and record.refusal is Refusal.UNKNOWN_PART
        if record is None or not (record.says_again or (is_asked and record.asked_what)):
            return
        words = said("its bytes cannot be read: {fault}", fault=fault)
        if size > MOST_DESCRIPTION:
            words = said("it is longer than {most} bytes", most=MOST_DESCRIPTION)
        if record.says_again:
            self._said_again(client_key, record, SelfDescription("", fault=words))
            return
        record.says = SelfDescription("", fault=words)
        self._changes.note(record, now, said("what it says of itself is refused: {fault}", fault=words))
        self._changes.publish()

    def checked(self, client_key: int, asked: SelfDescription, result: SelfDescription, now: float) -> None:
        """What a part said was checked; without effect when the part has gone, or has begun anew."""
        record = self._record(client_key)
        if record is None or record.says is not asked:
            return
        record.says = result
        words = said("what it says of itself is refused: {fault}", fault=result.fault)
        if result.described is not None:
            words = said("it describes itself: {name}; a person can adopt it", name=result.described.part_type.name)
        self._changes.note(record, now, words)
        self._changes.publish()

    def _said_again(self, client_key: int, record: InventoryRecord, says: SelfDescription) -> None:
        """Whoever has asked judges it: nothing is kept with the part, which has its type."""
        record.says_again = False
        number = "" if record.claim is None else record.claim.part_number
        for checker in self._checkers:
            self._changes.after_events(partial(checker, client_key, number, says))
        self._changes.publish()

    def _record(self, client_key: int) -> InventoryRecord | None:
        session = self._index.sessions.get(client_key)
        return None if session is None else session.record
