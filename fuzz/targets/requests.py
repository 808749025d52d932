"""The inventory's requests, in both layouts, through sessions that come and go, while time passes."""

from __future__ import annotations

from collections.abc import Iterable
from random import Random

from fuzz.bounds import REASONS, hold
from fuzz.case import Case, Step, Violation, plain
from fuzz.mutate import mutate_octets
from msbot.config import Slot
from msbot.part.join import pnp_messages, thesis_messages
from msbot.part.join.part_keys import prove
from msbot.pnp import FAST_TIMING, PartState
from msbot.pnp.key_proof import Keys
from msbot.pnp.requests import RequestHandler
from tests.pnp.robot import Rig, sample_store, uid

KEYS = 6
KEEP_ENDED = 4
"""Parts that the rig keeps after they have gone."""
HONEST = 99
KEY = bytes(range(16))


class RequestTarget:
    """See the module's docstring."""

    name = "requests"
    about = "the inventory: nothing raises, the books are bounded, an honest part gets its slot in the end"

    def make(self, random: Random) -> Case:
        """Requests, right and wrong."""
        steps = [Step("join", b"", (random.randrange(KEYS),))]
        return (*steps, *(_step(random) for _ in range(random.randrange(1, 30))))

    def run(self, case: Case) -> Iterable[str]:
        """Ask."""
        rig = Rig(sample_store(Slot("AA2", "ABCD")), timing=FAST_TIMING)
        keys = Keys(rig.store, Random(len(case))) if len(case) % 3 == 0 else None
        rig.store.keys = {uid(number): KEY for number in (0, 1, 2, HONEST)}
        handler = RequestHandler(rig.inventory, explain=len(case) % 2 == 0, keys=keys)
        seen: set[str] = set()
        leases: dict[int, int] = {}
        for step in case:
            key = 1 + abs(step.whole(0)) % KEYS
            seen.add(_do(rig, handler, step, key, leases))
            _check(rig, handler)
        seen.update(plain(event.reason, 40) for event in rig.events)
        seen.update(plain(reason) for reason in handler.dropped)
        _check_honest(rig, handler)
        return seen


def _do(rig: Rig, handler: RequestHandler, step: Step, key: int, leases: dict[int, int]) -> str:
    is_open = key in rig.inventory._index.sessions
    match step.verb:
        case "join":
            rig.join(key, quiet=bool(step.whole(1)))
        case "leave":
            rig.leave(key, politely=bool(step.whole(1)))
        case "wait":
            rig.run(min(abs(step.number(1)), 10.0))
        case "profile":
            rig.inventory.profile_asked(key, rig.now)
        case "compat":
            return _answered(handler.compat(step.data, key, rig.now), is_open=is_open)
        case "beat":
            lease = leases.get(key, 0).to_bytes(4, "little")
            return _answered(handler.compact(lease + step.data[:4], key, rig.now), is_open=is_open)
        case "compact":
            answer = handler.compact(step.data, key, rig.now)
            if (
                answer is not None
                and len(answer) == 12
                and (verdict := pnp_messages.VerdictMessage.decode(answer)).lease
            ):
                leases[key] = verdict.lease
                return f"lease, refused {verdict.reason}"
            return _answered(answer, is_open=is_open)
        case "prove":
            return _prove(handler, step, key, rig.now)
        case "why":
            rig.inventory.why(f"{key:08x}", rig.now)
        case "slots":
            slots = [slot for slot in rig.store.slot_list if slot.name != "AA2"]
            rig.store.slot_list = [*slots, Slot("AA2", "ABCD")] if step.whole(1) else slots
            rig.inventory.reload(rig.now)
    return step.verb


def _prove(handler: RequestHandler, step: Step, key: int, now: float) -> str:
    """Claim, and prove it if asked, with the right key or another one; the answer may come much later."""
    asker = key.to_bytes(16, "big")
    claim = pnp_messages.ClaimMessage(part_number="ABCD", local_name="", uid=uid(step.whole(1) % 4), session_nonce=1)
    asked = handler.compact(claim.encode(), key, now, asker)
    if asked is None or len(asked) != pnp_messages.NONCE_OCTETS:
        return "not asked"
    secret = KEY if step.whole(2) % 2 else bytes(16)
    names = {"part_number": claim.part_number, "local_name": claim.local_name}
    proof = prove(secret, asked, claim.uid, **names, session_key=key)
    answer = handler.compact(pnp_messages.Proof(proof=proof).encode(), key, now + abs(step.whole(3)) % 15, asker)
    is_in = answer is not None and len(answer) == 12 and pnp_messages.VerdictMessage.decode(answer).lease
    if is_in and secret is not KEY:
        raise Violation("a part with another key is let in")
    return f"proved, answered {None if answer is None else len(answer)}"


def _answered(answer: bytes | None, *, is_open: bool) -> str:
    if answer is not None and not is_open and len(answer) != 4:
        raise Violation(f"a client without a session is answered {answer.hex()}")
    return f"answer of {None if answer is None else len(answer)}"


def _check(rig: Rig, handler: RequestHandler) -> None:
    index = rig.inventory._index
    hold("reasons of dropped requests", len(handler.dropped), REASONS)
    hold("reasons of the inventory", len(rig.inventory.dropped), REASONS)
    hold("sessions", len(index.sessions), KEYS + 1)
    hold("records", len(index.records), KEYS + 1 + KEEP_ENDED)
    hold("holders", len(index.holders), len(rig.store.slot_list))
    hold("leases", len(index._by_lease), len(index.holders))
    hold("identities", len(index._by_identity), len(index.records))
    for record in index.records:
        hold("duplicates", len(record.duplicates), 8)
    registered = [part.slot for part in rig.inventory.view(rig.now) if part.state.is_registered]
    if None in registered or len(set(registered)) != len(registered):
        raise Violation(f"registered parts sit in {registered}")


def _check_honest(rig: Rig, handler: RequestHandler) -> None:
    for key in range(1, KEYS + 1):
        rig.leave(key, "end of the case")
    rig.run(20.0)
    rig.join(HONEST)
    claim = pnp_messages.ClaimMessage(part_number="ABCD", local_name="AA", uid=uid(HONEST), session_nonce=1).encode()
    answer = handler.compact(claim, HONEST, rig.now)
    if answer is not None and len(answer) == pnp_messages.NONCE_OCTETS:
        proof = prove(KEY, answer, uid(HONEST), part_number="ABCD", local_name="AA", session_key=HONEST)
        answer = handler.compact(pnp_messages.Proof(proof=proof).encode(), HONEST, rig.now)
    if (
        answer is None
        or not pnp_messages.VerdictMessage.decode(answer).lease
        or rig.state(HONEST) is not PartState.ACTIVE
    ):
        raise Violation(f"an honest part is answered {answer!r}")


def _step(random: Random) -> Step:
    key = random.randrange(KEYS)
    match random.randrange(16):
        case 0:
            return Step("join", b"", (key, random.randrange(2)))
        case 1:
            return Step("leave", b"", (key, random.randrange(2)))
        case 2 | 3:
            return Step("wait", b"", (key, random.choice((0.05, 0.2, 0.5, 1.0, 7.0))))
        case 4:
            return Step(random.choice(("profile", "why")), b"", (key,))
        case 5:
            return Step("slots", b"", (key, random.randrange(2)))
        case 6 | 7:
            return Step("beat", random.choice((b"", b"", b"\1\0\0\0", b"\0\0")), (key,))
        case 8 | 9:
            request = thesis_messages.encode_request(_number(random), random.choice(("", "left", "ä" * 20)))
            return Step("compat", mutate_octets(random, request) if random.random() < 0.5 else request, (key,))
        case 10 | 11:
            return Step("prove", b"", (key, random.randrange(4), random.randrange(2), random.choice((0, 0, 0, 12))))
    claim = pnp_messages.ClaimMessage(
        part_number=_number(random),
        local_name=random.choice(("", "AA", "AA2", "x" * 254)),
        uid=uid(random.randrange(5)),
        session_nonce=random.randrange(2),
    ).encode()
    return Step("compact", mutate_octets(random, claim) if random.random() < 0.4 else claim, (key,))


def _number(random: Random) -> str:
    return random.choice(("ABCD", "ABCD", "EFGH", "WXYZ", "NOPE", "", "a\nb"))
