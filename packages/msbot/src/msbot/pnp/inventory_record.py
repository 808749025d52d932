"""What the inventory keeps about one part; every change of state goes through `InventoryRecord.move`."""

from __future__ import annotations

from collections import deque
from math import inf
from typing import Final

from msbot.part.join.hardware_trouble import TROUBLE_ENDS, TROUBLE_OCTETS, TROUBLE_PIECES
from msbot.part.join.home import Home, ToldHome, read_home
from msbot.part.join.part_log import LEVEL_BITS, LEVEL_SHIFT, LineRate, LogLevel, VersionOf
from msbot.part.join.pnp_messages import Nature
from msbot.part.join.refusal import Refusal
from msbot.pnp.life_status import Life, check_transition
from msbot.pnp.model import Claim, Configuration, LifeTiming, PartInfo, ProgramLogLine, SelfDescription, TypeDifference
from msbot.pnp.part_events import Evidence, PartEvent, PartState
from msbot_agent.text.sentence import Sentence, joined, said

HISTORY = 32
"""Changes kept per part for `Inventory.why`; the journal keeps all."""

_MAX_DUPLICATES = 8

_RUNS: Final = {
    Home.PC: "It runs on a computer, with MsBOT {version}.",
    Home.MICROPYTHON: "It runs under MicroPython, with MsBOT {version}.",
    Home.C: "It is a program in C, with MsBOT {version}.",
    Home.BROWSER: "It runs in a browser, with MsBOT {version}.",
    Home.BRIDGE: "A bridge speaks for it, with MsBOT {version}.",
}
FORMS: Final = tuple(_RUNS.values())
"""Forms of sentences, for whoever looks for their translations."""

LOG_LINES = 20
"""Lines kept of what a part's program logs."""


class DuplicateClaim:
    """A claim with the UID of a part that holds a slot in another session: not decided yet."""

    __slots__ = ("began_at", "rival")

    def __init__(self, rival: InventoryRecord, began_at: float) -> None:
        self.rival = rival
        self.began_at = began_at


class InventoryRecord:
    """One part: who it is, its state, and how it got there.

    Args:
        client_key: its session.
        address: the peer in words.
        timing: the robot's periods.
        plugged_in_at: when its session was opened, or the link saw it arrive.
    """

    __slots__ = (
        "address",
        "asked_what",
        "claim",
        "client_key",
        "configuration",
        "contest",
        "duplicates",
        "hardware",
        "heard_at",
        "history",
        "holds_slot",
        "home",
        "identity",
        "is_held",
        "lease",
        "life",
        "log",
        "log_noted_at",
        "log_rate",
        "nature",
        "plug_in_to_active_s",
        "plugged_in_at",
        "reason",
        "refusal",
        "refused_claims",
        "refused_samples",
        "says",
        "says_again",
        "since",
        "slot",
        "software",
        "spoke_unasked",
        "state",
        "trouble",
        "trouble_pieces",
        "type_differences",
        "type_notes",
    )

    def __init__(self, client_key: int, address: str, timing: LifeTiming, plugged_in_at: float) -> None:
        self.client_key = client_key
        self.address = address
        self.life = Life(timing)
        self.plugged_in_at: float | None = plugged_in_at
        """When its way through the two steps began, with a session or a claim; None: it has not begun."""
        self.plug_in_to_active_s: float | None = None
        self.state: PartState | None = None
        self.since = plugged_in_at
        self.reason = ""
        self.claim: Claim | None = None
        self.identity = b""
        """The UID, or for a part without one a name made from the session; empty before the first claim."""
        self.slot: str | None = None
        """The slot that it holds, or held last."""
        self.holds_slot = False
        self.is_held = False
        """A teacher holds the pupil who runs it: it has its slot, and uses no topic."""
        self.lease = 0
        self.configuration: Configuration | None = None
        self.refusal: Refusal | None = None
        self.nature = Nature.UNKNOWN
        """What is behind its ports, as the part itself says."""
        self.hardware = self.software = self.trouble = ""
        """Versions, as the part itself says, or said in its session before; and what is wrong with its hardware, as
        it said before it ended."""
        self.home = ToldHome()  # where it runs, as it says likewise
        self.trouble_pieces = b""
        self.log: deque[ProgramLogLine] = deque(maxlen=LOG_LINES)
        """What its program logged last."""
        self.log_rate: LineRate | None = None
        """How many lines are taken of it."""
        self.log_noted_at = -inf
        """When the journal got the last one."""
        self.type_differences: dict[tuple[str, bool], TypeDifference] = {}
        """By port; at most as many as its configuration has."""
        self.type_notes = 0
        """Lines of the journal about them."""
        self.refused_claims = 0
        self.refused_samples = 0
        """Samples that showed its session but had no valid seal."""
        self.asked_what = 0
        """How many times it was asked what it is."""
        self.says: SelfDescription | None = None
        """What it answered."""
        self.spoke_unasked = self.says_again = False
        """It said what it is although nobody asked, noted once; and it is asked while it is in the robot, because a
        person adopts it anew."""
        self.contest: DuplicateClaim | None = None
        self.heard_at = plugged_in_at
        """When it last claimed or sent a beat."""
        self.duplicates: deque[str] = deque(maxlen=_MAX_DUPLICATES)
        self.history: deque[PartEvent] = deque(maxlen=HISTORY)

    @property
    def is_registered(self) -> bool:
        """Whether it is active or late."""
        return self.state is not None and self.state.is_registered

    @property
    def name(self) -> str:
        """What people call it: local name, else slot, else part number, else address."""
        claim = self.claim
        known = "" if claim is None else claim.local_name or self.slot or claim.part_number
        return known or said("{address}", address=self.address)  # a name of its own, to be hidden from students

    def move(self, to: PartState, now: float, reason: str, evidence: Evidence = ()) -> PartEvent:
        """Enter another state; everything else must be up to date already.

        Raises:
            LocalProtocolError: the change is not in the table of `msbot.pnp.life_status`.
        """
        check_transition(self.state, to)
        event = self._event(to, now, reason, evidence)
        self.state, self.since, self.reason = to, now, reason
        self.history.append(event)
        return event

    def note(self, now: float, reason: str, evidence: Evidence = ()) -> PartEvent:
        """Note something that happened to the part without changing its state; it must have a state."""
        assert self.state is not None
        event = self._event(self.state, now, reason, evidence)
        self.history.append(event)
        return event

    def _event(self, to: PartState, now: float, reason: str, evidence: Evidence) -> PartEvent:
        claim = self.claim
        return PartEvent(
            at=now,
            part=self.name,
            slot=self.slot if self.holds_slot or to.is_over else None,
            from_state=self.state,
            to_state=to,
            reason=reason,
            evidence=evidence,
            part_number=claim.part_number if claim else "",
            local_name=claim.local_name if claim else "",
            uid=claim.uid if claim else b"",
            client_key=self.client_key,
            address=self.address,
            identity=self.identity,
            trouble=self.trouble,
        )

    def succeed(self, old: InventoryRecord) -> None:
        """Continue the history of the same part's earlier session."""
        self.history = deque((*old.history, *self.history), maxlen=HISTORY)
        self.refused_claims += old.refused_claims
        self.refused_samples += old.refused_samples
        if self.slot is None:
            self.slot = old.slot
        self.hardware, self.software = self.hardware or old.hardware, self.software or old.software
        if self.home == ToldHome():
            self.home = old.home

    def take_nature(self, number: int) -> None:
        """The part says what is behind its ports (`Nature`)."""
        self.nature = Nature.of(number)

    def forget_description(self) -> None:
        """Another program may speak for the part now: what it said of itself does not count, and it may be asked."""
        self.asked_what, self.says = 0, None

    def take_version(self, of: VersionOf, text: str) -> str:
        """The part says a version; the one that it said before is returned."""
        text, before = text.strip(), self.hardware if of is VersionOf.HARDWARE else self.software
        if of is VersionOf.HOME:
            before, self.home = self.home.version, read_home(text)
        elif of is VersionOf.HARDWARE:
            self.hardware = text
        else:
            self.software = text
        return before

    def take_piece(self, place: int, piece: bytes) -> tuple[LogLevel | VersionOf, str] | None:
        """The part says a piece of what is wrong with its hardware, of a line of its log, or of a version
        (`TroublePiece`).

        A line or version that is complete is returned.
        """
        number, level = place & ~(TROUBLE_ENDS | LEVEL_BITS), (place & LEVEL_BITS) >> LEVEL_SHIFT
        at = number * TROUBLE_OCTETS
        if at == 0:
            self.trouble_pieces = b""
        if at != len(self.trouble_pieces) or at >= TROUBLE_PIECES * TROUBLE_OCTETS:
            self.trouble_pieces = b""  # one is missing, or they are too many
            return None
        self.trouble_pieces += piece
        if not place & TROUBLE_ENDS:
            return None
        text = self.trouble_pieces.rstrip(b"\0").decode(errors="replace")
        words = "".join(letter for letter in text if letter.isprintable())
        if level in (one.value for one in LogLevel):
            return LogLevel(level), words
        if level in (one.value for one in VersionOf):
            return VersionOf(level), words
        if not level:
            self.trouble = words
        return None

    def with_what_was_said(self, reason: str) -> str:
        """Why the part has gone, with what explains it: its own words, or why it had no place."""
        if self.trouble:
            return said("{reason}; it said: {trouble}", reason=reason, trouble=self.trouble)
        if self.state is PartState.REFUSED:
            return said("{reason}; it was refused: {why}", reason=reason, why=self.reason)
        return reason

    def note_duplicate(self, address: str) -> None:
        """Remember where a device with the same UID was seen; each address once."""
        if address not in self.duplicates:
            self.duplicates.append(address)

    @property
    def shown_life(self) -> int:
        """Life status as people see it: steady at its full height while the part is active.

        The timer takes one off a healthy part, too, and its next beat gives it back; that is no news.
        """
        return self.life.timing.life if self.state is PartState.ACTIVE else self.life.status

    def info(self, now: float, slot: str | None) -> PartInfo:
        """The part as tables show it, in that slot."""
        claim, active_s, heard = self.claim, self.plug_in_to_active_s, self.life.last_beat_at
        return PartInfo(
            part=self.name,
            part_number=claim.part_number if claim else "",
            local_name=claim.local_name if claim else "",
            uid=claim.uid if claim else b"",
            slot=slot,
            state=self.state or PartState.NEW,
            reason=self.reason,
            state_age_s=max(0.0, now - self.since),
            life=self.shown_life,
            beat_age_s=None if heard is None else self.life.silence_s(now),
            beats=self.life.beats,
            plug_in_to_active_ms=None if active_s is None else active_s * 1000,
            client_key=self.client_key,
            address=self.address,
            refused_claims=self.refused_claims,
            duplicates=tuple(self.duplicates),
            refusal=None if self.is_registered else self.refusal,
            nature=self.nature,
            hardware=self.hardware,
            software=self.software,
            home=self.home.label,
            msbot=self.home.version,
            says=self.says if self.refusal is Refusal.UNKNOWN_PART and not self.is_registered else None,
        )

    def sentences(self, now: float) -> list[str]:
        """The part's state and the chain of changes that led to it, oldest first."""
        lines: list[str] = [said("{words}: {reason}", words=self._headline(now), reason=self.reason)]
        if runs := runs_in_words(self.home.label, self.home.version):
            lines.append(runs)
        if self.duplicates:
            addresses = ", ".join(self.duplicates)
            lines.append(said("The same UID was shown, and refused, at {addresses}.", addresses=addresses))
        if self.refused_samples:
            lines.append(said("Samples in its name without a good seal, refused: {count}.", count=self.refused_samples))
        for event in self.history:
            first, *rest = event.sentences()
            lines.append(said("{age} ago: {first}", age=lasting(now - event.at), first=first))
            lines.extend(rest)
        return lines

    def _headline(self, now: float) -> str:
        name: str = self.name
        if self.claim is not None:
            versions = versions_in_words(self.hardware, self.software)
            number = self.claim.part_number
            name = joined("", (name, " (", number, *((", ", versions) if versions else ()), ")"))
        state, age = said((self.state or PartState.NEW).value), lasting(now - self.since)
        words = said("{name} is {state} since {age}", name=name, state=state, age=age)
        if not self.holds_slot:
            return words
        silence, beat_s = self.life.silence_s(now), self.life.timing.beat_s
        known = {"words": words, "slot": self.slot, "life": self.shown_life}
        if silence < beat_s:  # as long as it is not overdue, nobody needs a number that changes while it is read
            return said(
                "{words} in slot {slot}, life {life}, last beat less than {beat_s:g} s ago", **known, beat_s=beat_s
            )
        return said("{words} in slot {slot}, life {life}, last beat {silence:.1f} s ago", **known, silence=silence)


def runs_in_words(home: str, version: str) -> Sentence | None:
    """Where a part runs, by the label of its home, and with which version of MsBOT; None: it has not said."""
    form = next((form for one, form in _RUNS.items() if one.label == home), None)
    return None if form is None else said(form, version=version or said("not known"))


def versions_in_words(hardware: str, software: str) -> str:
    """`hardware 1.2, software 3`; empty: neither is known."""
    known = []
    if hardware:
        known.append(said("hardware {version}", version=hardware))
    if software:
        known.append(said("software {version}", version=software))
    return joined(", ", known)


def lasting(seconds: float) -> Sentence:
    """A time as people say it: as exact as matters after so long."""
    if seconds < 9.95:
        return said("{seconds:.1f} s", seconds=max(0.0, seconds))
    for size, limit, form in ((1, 120, "{count} s"), (60, 120, "{count} min"), (3600, 48, "{count} h")):
        if seconds < size * limit:
            return said(form, count=round(seconds / size))
    return said("{count} days", count=round(seconds / 86_400))
