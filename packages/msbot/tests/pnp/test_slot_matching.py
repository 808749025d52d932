"""Auto-matching: every rule, the chain of evidence it leaves, and that it goes by index."""

from __future__ import annotations

import pytest

from msbot.config import PartType, Slot
from msbot.pnp import Claim, Group, MemoryStore, PartState, Refusal
from msbot.pnp.slot_matching import Match, Matcher
from msbot_xrce.errors import RegistryError
from tests.pnp.robot import ABCD, EFGH, sample_store, uid

OTHER = PartType("LED1", "lamp")
FITS_ABCD = PartType("ABCE", "light sensor, new make", compatible_with=("ABCD",))


def matcher_of(
    *slots: Slot, types: tuple[PartType, ...] = (ABCD, EFGH, OTHER, FITS_ABCD)
) -> tuple[Matcher, MemoryStore]:
    store = MemoryStore(types=types, slots=slots)
    return Matcher(store), store


def rules(match: Match) -> list[str]:
    return [rule for rule, _ in match.evidence]


def test_the_one_free_slot_that_fits_is_found() -> None:
    matcher = Matcher(sample_store())
    match = matcher.match(Claim("EFGH", "whatever", uid(1)))
    assert match.outcome is PartState.ACTIVE
    assert match.slot == Slot("BB", "EFGH")
    assert match.reason == "slot BB is the one free slot that fits"
    assert rules(match) == ["claim", "library", "blocked", "slots", "same UID as before", "slot"]
    assert match.evidence[1] == ("library", "EFGH: toggle switch")


@pytest.mark.parametrize(
    ("claim", "words"),
    [
        (Claim(""), "no part number"),
        (Claim("A" * 255), "longer than 254"),
        (Claim("ABCD", "B" * 255), "longer than 254"),
        (Claim("AB\x1b[2JCD"), "control characters"),
        (Claim("ABCD", "", b"123"), "UID has 3 bytes instead of 8"),
    ],
)
def test_a_claim_that_makes_no_sense_is_refused(claim: Claim, words: str) -> None:
    match = Matcher(sample_store()).match(claim)
    assert (match.outcome, match.refusal) == (PartState.REFUSED, Refusal.BAD_CLAIM)
    assert words in match.reason


def test_a_part_number_that_the_library_does_not_know_is_refused() -> None:
    match = Matcher(sample_store()).match(Claim("NOPE"))
    assert (match.outcome, match.refusal, match.slot) == (PartState.REFUSED, Refusal.UNKNOWN_PART, None)
    assert match.reason == "part number NOPE is not in the library"
    assert match.evidence[-1] == ("unknown part", match.reason)


def test_part_numbers_match_exactly() -> None:
    matcher = Matcher(sample_store())
    for number in ("abcd", "ABCD ", "ABC", "ABCDE"):
        assert matcher.match(Claim(number)).refusal is Refusal.UNKNOWN_PART


@pytest.mark.parametrize("key", [uid(1), "ABCD"])
def test_a_blocked_part_or_number_is_refused_with_the_reason(key: bytes | str) -> None:
    store = sample_store()
    store.blocks[key] = "smells burnt"
    match = Matcher(store).match(Claim("ABCD", "", uid(1)))
    assert match.refusal is Refusal.BLOCKED
    assert match.reason == "blocked: smells burnt"


def test_a_known_part_of_another_robot_is_refused() -> None:
    matcher, _ = matcher_of(Slot("AA", "ABCD"))
    match = matcher.match(Claim("LED1"))
    assert match.refusal is Refusal.WRONG_ROBOT
    assert match.reason == "LED1 (lamp) is known, but this robot has no slot for it"


def test_a_compatible_part_takes_a_slot_of_the_other_number() -> None:
    matcher, _ = matcher_of(Slot("AA", "ABCD"))
    match = matcher.match(Claim("ABCE"))
    assert match.slot == Slot("AA", "ABCD")


def test_slots_of_the_exact_number_come_before_compatible_ones() -> None:
    matcher, _ = matcher_of(Slot("old", "ABCD"), Slot("new", "ABCE"))
    assert matcher.match(Claim("ABCE")).slot == Slot("new", "ABCE")
    matcher.take("new")
    assert matcher.match(Claim("ABCE")).slot == Slot("old", "ABCD")


def test_the_same_uid_gets_its_old_slot() -> None:
    matcher, store = matcher_of(Slot("left", "ABCD"), Slot("right", "ABCD"))
    store.remembered[uid(1)] = "right"
    match = matcher.match(Claim("ABCD", "left", uid(1)))
    assert match.slot == Slot("right", "ABCD")
    assert match.reason == "same UID as before: back in its slot right"


def test_an_old_slot_that_is_held_or_fits_no_more_is_passed_over_and_said_so() -> None:
    matcher, store = matcher_of(Slot("left", "ABCD"), Slot("right", "ABCD"), Slot("lamp", "LED1"))
    store.remembered[uid(1)] = "right"
    store.remembered[uid(2)] = "lamp"
    store.remembered[uid(3)] = "gone"
    matcher.take("right")
    outcomes = [dict(matcher.match(Claim("ABCD", "", uid(n))).evidence)["same UID as before"] for n in (1, 2, 3)]
    assert outcomes == [
        "was in slot right, which is held by another part",
        "was in slot lamp, which does not take this number now",
        "was in slot gone, which does not take this number now",
    ]


def test_among_several_free_slots_the_local_name_decides() -> None:
    matcher, _ = matcher_of(Slot("left", "ABCD"), Slot("right", "ABCD", "wheel-r"))
    assert matcher.match(Claim("ABCD", "left")).slot == Slot("left", "ABCD")
    match = matcher.match(Claim("ABCD", "wheel-r"))
    assert match.slot == Slot("right", "ABCD", "wheel-r")
    assert match.reason == "2 free slots fit; local name 'wheel-r' decides"


def test_several_free_slots_and_no_telling_name_is_standby() -> None:
    matcher, _ = matcher_of(Slot("left", "ABCD"), Slot("right", "ABCD"), Slot("rear", "ABCD"))
    matcher.take("rear")
    for name in ("", "rear", "middle"):
        match = matcher.match(Claim("ABCD", name))
        assert (match.outcome, match.refusal) == (PartState.STANDBY, Refusal.NO_SLOT)
        assert "a person must say" in match.reason


def test_no_free_slot_is_standby_until_one_is_released() -> None:
    matcher = Matcher(sample_store())
    matcher.take("AA")
    match = matcher.match(Claim("ABCD"))
    assert (match.outcome, match.reason) == (PartState.STANDBY, "every fitting slot is taken")
    matcher.release("AA")
    assert matcher.match(Claim("ABCD")).outcome is PartState.ACTIVE


def test_a_reload_knows_new_slots_and_keeps_held_ones_held() -> None:
    store = sample_store()
    matcher = Matcher(store)
    matcher.take("AA")
    store.slot_list.append(Slot("AA2", "ABCD"))
    del store.slot_list[2]
    matcher.reload(frozenset({"AA"}))
    assert matcher.match(Claim("ABCD")).slot == Slot("AA2", "ABCD")
    assert matcher.match(Claim("WXYZ")).refusal is Refusal.WRONG_ROBOT
    assert (matcher.has("AA2"), matcher.has("CC")) == (True, False)
    matcher.release("CC")
    assert matcher.match(Claim("WXYZ")).refusal is Refusal.WRONG_ROBOT


def test_a_registry_that_cannot_be_read_refuses_and_does_not_raise() -> None:
    class Broken(MemoryStore):
        def part_type(self, number: str) -> PartType | None:
            raise RegistryError("robot.db: disk is gone")

    match = Matcher(Broken(slots=(Slot("AA", "ABCD"),))).match(Claim("ABCD"))
    assert match.refusal is Refusal.NOT_READY
    assert match.reason == "the inventory cannot read its registry: robot.db: disk is gone"


def test_evidence_stays_short_with_many_slots() -> None:
    matcher, _ = matcher_of(*(Slot(f"s{n}", "ABCD") for n in range(100)))
    assert dict(matcher.match(Claim("ABCD")).evidence)["slots"] == "s0, s1, s2, s3, s4, s5, s6, s7 and 92 more"


def test_a_match_looks_only_at_what_the_index_gives() -> None:
    class Counting(MemoryStore):
        reads = 0

        def slots(self) -> tuple[Slot, ...]:
            self.reads += 1
            return super().slots()

    types = tuple(PartType(f"N{n}", f"part {n}") for n in range(1000))
    store = Counting(types=types, slots=tuple(Slot(f"s{n}", f"N{n}") for n in range(1000)))
    matcher = Matcher(store)
    for n in range(1000):
        match = matcher.match(Claim(f"N{n}"))
        assert match.slot is not None
        assert match.slot.name == f"s{n}"
    assert store.reads == 1


class VersionStore(MemoryStore):
    """A store that finds `ABCD` for `ABCD@2`, as the registry does."""

    def part_type(self, number: str) -> PartType | None:
        return super().part_type(number.partition("@")[0])


def test_a_version_behind_the_number_gets_the_slot_of_the_number() -> None:
    store = VersionStore(types=(ABCD,), slots=(Slot("AA", "ABCD"),))
    match = Matcher(store).match(Claim("ABCD@2", "any", uid(1)))
    assert match.slot == Slot("AA", "ABCD")


def test_a_blocked_number_cannot_be_got_round_with_a_version() -> None:
    store = VersionStore(types=(ABCD,), slots=(Slot("AA", "ABCD"),))
    store.blocks["ABCD"] = "recalled"
    match = Matcher(store).match(Claim("ABCD@2", "any", uid(1)))
    assert (match.refusal, match.reason) == (Refusal.BLOCKED, "blocked: recalled")


# What people decide


def test_a_part_that_a_person_put_into_a_slot_gets_it_whatever_the_library_says() -> None:
    matcher, store = matcher_of(Slot("AA", "ABCD"))
    store.placed[uid(1)] = "AA"
    match = matcher.match(Claim("NOPE", "", uid(1)))
    assert match.slot == Slot("AA", "ABCD")
    assert match.reason == "a person has put this part into slot AA"
    assert matcher.match(Claim("NOPE", "", uid(2))).refusal is Refusal.UNKNOWN_PART


@pytest.mark.parametrize(("slot", "words"), [("AA", "is held by another part"), ("ZZ", "does not have any more")])
def test_a_place_that_cannot_be_had_is_evidence_and_the_rules_go_on(slot: str, words: str) -> None:
    matcher, store = matcher_of(Slot("AA", "ABCD"), Slot("AB", "ABCD"))
    matcher.take("AA")
    store.placed[uid(1)] = slot
    match = matcher.match(Claim("ABCD", "", uid(1)))
    assert match.slot == Slot("AB", "ABCD")
    assert any(rule == "put there by a person" and words in outcome for rule, outcome in match.evidence)


def test_a_person_who_blocks_a_part_outdoes_one_who_placed_it() -> None:
    matcher, store = matcher_of(Slot("AA", "ABCD"))
    store.placed[uid(1)] = "AA"
    store.blocks[uid(1)] = "broken"
    assert matcher.match(Claim("ABCD", "", uid(1))).refusal is Refusal.BLOCKED


def test_a_barred_slot_counts_as_taken_for_that_part_only() -> None:
    matcher, store = matcher_of(Slot("AA", "ABCD"))
    store.remembered[uid(1)] = "AA"
    match = matcher.match(Claim("ABCD", "", uid(1)), barred="AA")
    assert (match.outcome, match.slot) == (PartState.STANDBY, None)
    assert ("same UID as before", "was in slot AA, and a person took it out of there") in match.evidence
    assert matcher.match(Claim("ABCD", "", uid(2))).slot == Slot("AA", "ABCD")


def test_fits_says_what_the_library_says() -> None:
    matcher, _ = matcher_of(Slot("AA", "ABCD"))
    assert [matcher.fits(number, "AA") for number in ("ABCD", "ABCE", "EFGH", "NOPE")] == [True, True, False, False]
    assert matcher.free_slot("AA") == Slot("AA", "ABCD")
    matcher.take("AA")
    assert (matcher.free_slot("AA"), matcher.free_slot("ZZ"), matcher.names()) == (None, None, ("AA",))


EIGHT = tuple(Slot(f"s{number}", "ABCD") for number in range(8))


@pytest.mark.parametrize(
    ("slots", "words"),
    [
        (EIGHT[:2], "s0, s1"),
        (EIGHT, "s0, s1, s2, s3, s4, s5, s6, s7"),
        ((*EIGHT, Slot("s8", "ABCD")), "s0, s1, s2, s3, s4, s5, s6, s7 and 1 more"),
        ((*EIGHT, Slot("e0", "ABCE"), Slot("e1", "ABCE")), "e0, e1, s0, s1, s2, s3, s4, s5 and 2 more"),
    ],
)
@pytest.mark.parametrize("octets", [uid(1), b""])
def test_the_whole_chain_of_evidence(slots: tuple[Slot, ...], words: str, octets: bytes) -> None:
    matcher, _ = matcher_of(*slots)
    number = "ABCE" if "e0" in words else "ABCD"
    name = "sensor, new make" if number == "ABCE" else "sensor"
    count = 2 if number == "ABCE" else len(slots)
    match = matcher.match(Claim(number, "x", octets))
    wait = f"{count} free slots fit and local name 'x' names none of them: a person must say"
    who = "UID 0000000000000001" if octets else "no UID"
    assert match == Match(
        PartState.STANDBY,
        wait,
        (
            ("claim", f"part number {number}, local name 'x', {who}"),
            ("library", f"{number}: light {name}"),
            ("blocked", "no"),
            ("slots", words),
            ("same UID as before", "never seen here" if octets else "the part has no UID"),
            ("slot", wait),
        ),
        refusal=Refusal.NO_SLOT,
    )


@pytest.mark.parametrize(("number", "name"), [("A" * 254, ""), ("ABCD", "B" * 254)])
def test_a_text_of_254_characters_can_be_claimed(number: str, name: str) -> None:
    matcher, _ = matcher_of(Slot("AA", "ABCD"), Slot("long", "A" * 254), types=(ABCD, PartType("A" * 254, "long")))
    assert matcher.match(Claim(number, name)).outcome is PartState.ACTIVE


def test_what_a_pupil_is_told_of_other_groups_slots() -> None:
    matcher, store = matcher_of(Slot("left", "ABCD"), Slot("right", "ABCD"))
    store.remembered[uid(1)] = "right"

    def told(pupil: str) -> list[tuple[str, str]]:
        match = matcher.match(Claim("ABCD", "left", uid(1)), pupil=pupil)
        return [(rule, words) for rule, words in match.evidence if rule in ("group", "same UID as before", "slot")]

    back = [("slot", "same UID as before: back in its slot right")]
    assert told("") == told("ada") == back
    matcher.pupils.use_groups([Group("Red", ("ben",), ("right",))])
    others = ("group", "free slots of other groups are not for ada")
    only = ("slot", "slot left is the one free slot that fits")
    assert told("ada") == [("same UID as before", "slot right belongs to group Red"), others, only]
    assert told("") == told("ben") == back
    store.remembered.clear()
    assert told("ben") == [
        ("same UID as before", "never seen here"),
        ("slot", "slot right is the one free slot that fits"),
    ]
