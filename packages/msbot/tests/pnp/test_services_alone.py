"""The inventory's service by itself: whatever is asked or happens, all that it says is compared, and what it keeps."""

from __future__ import annotations

import asyncio
from collections import deque
from functools import partial

import pytest

from msbot.part import Client, Entity
from msbot.part.join import pnp_messages, thesis_messages
from msbot.part.join.refusal import Refusal
from msbot.pnp import Claim, Configuration, InventoryService, PartEvent, PartState
from msbot.pnp.inventory_service import ANSWERED_S, LATEST_S, LONGEST_BEST_EFFORT, TOLD_IN_TURN
from msbot.pnp.life_status import TRANSITIONS
from msbot.pnp.refusal_help import help_message
from msbot.process.virtual_time import run_virtual
from msbot_agent.link import InprocHub
from msbot_xrce.errors import LinkFull
from msbot_xrce.messages import STREAM_BEST_EFFORT, STREAM_RELIABLE
from tests.pnp.robot import Rig, configuration, uid
from tests.pnp.scene import epoch_ns

Said = tuple[int, bool, pnp_messages.Reply | str, int]
"""To whom, whether it answers a request, what, and on which stream."""


class Mouth(Client):
    """A client that keeps what it would send, and what it was waited for."""

    is_full = False
    sent: list[tuple[int, bytes, bytes, int]]
    waited: list[tuple[str, float | None]]

    def reply(self, entity: Entity, identity: bytes, payload: bytes, *, stream_id: int = STREAM_RELIABLE) -> int:
        if self.is_full:
            raise LinkFull("the stream is full")
        self.sent.append((entity.object_id, identity, payload, stream_id))
        return 1

    async def connect(self, timeout_s: float | None = None) -> None:
        self.waited.append(("connect", timeout_s))

    async def until_all_statuses(self, timeout_s: float = 1.0) -> None:
        self.waited.append(("all", timeout_s))


def guid(key: int, requester: int = 1) -> bytes:
    """As the agent makes it for a requester of a client."""
    return bytes(8) + key.to_bytes(4, "big") + requester.to_bytes(4, "big")


class Desk:
    """An inventory, its service, and what is said."""

    def __init__(self, *, explain: bool = False) -> None:
        self.rig = Rig(start=asyncio.get_running_loop().time())
        make = partial(Mouth, InprocHub().connect(), key=2, epoch_ns=epoch_ns)
        self.service = InventoryService(make, self.rig.inventory, explain=explain)
        mouth = self.service._client
        assert isinstance(mouth, Mouth)
        self.mouth = mouth
        mouth.sent, mouth.waited = [], []
        self.compact, self.compat = self.service._compact.object_id, self.service._compat.object_id

    def said(self) -> list[Said]:
        """What was said since the last time, with each answer's request checked."""
        found: list[Said] = []
        for object_id, identity, payload, stream in self.mouth.sent:
            key, number = int.from_bytes(identity[8:12], "big"), int.from_bytes(identity[16:], "big")
            reply = (
                pnp_messages.decode_reply(payload)
                if object_id == self.compact
                else thesis_messages.decode_reply(payload)
            )
            assert (object_id == self.compat) is isinstance(reply, str)
            assert len(identity) == 24
            assert number in (0, 77)
            found.append((key, bool(number), reply, stream))
        self.mouth.sent.clear()
        return found

    def ask(self, key: int, message: pnp_messages.Request | bytes, *, requester: int = 1) -> list[Said]:
        """A client of the agent asks."""
        self.rig.now = asyncio.get_running_loop().time()
        body = message if isinstance(message, bytes) else message.encode()
        object_id = self.compat if len(body) == thesis_messages.BUFFER_BYTES else self.compact
        self.mouth._on_request(object_id, 0, guid(key, requester) + (77).to_bytes(8, "big"), body)
        assert set(self.service._leases) <= set(self.service._askers)
        assert set(self.service._go_again) <= set(self.service._askers)
        assert self.service._asking is None
        return self.said()

    def claim(self, key: int, number: str, *, nonce: int = 1, serial: int = 0, requester: int = 1) -> list[Said]:
        message = pnp_messages.ClaimMessage(
            part_number=number, local_name="", uid=uid(serial or key), session_nonce=nonce
        )
        return self.ask(key, message, requester=requester)

    def join(self, key: int, number: str) -> int:
        """A part comes in and gets a slot; its lease."""
        self.rig.join(key)
        ((_, is_answer, verdict, _),) = self.claim(key, number)
        assert is_answer
        assert isinstance(verdict, pnp_messages.VerdictMessage)
        return verdict.lease

    def stopped(self) -> tuple[list[str], tuple[str, ...]]:
        """Who has confirmed STOP, and who has not."""
        status = self.service.stop.status()
        return [one.part for one in status.confirmed], status.silent


def unasked(key: int, kind: pnp_messages.NoticeKind, number: int = 0, binding: int = 0xFFFF) -> Said:
    """A notice, as docs/reference/messages.md describes it."""
    return (key, False, pnp_messages.Notice(number=number, binding=binding, kind=kind), STREAM_BEST_EFFORT)


def answer(key: int, reply: pnp_messages.Reply | str) -> Said:
    return (key, True, reply, STREAM_BEST_EFFORT)


def test_a_part_that_waited_is_answered_once_when_its_own_claim_brings_it_in() -> None:
    async def scene() -> None:
        desk = Desk(explain=True)
        desk.rig.join(1)
        desk.rig.store.blocks[uid(1)] = "broken"
        refused = pnp_messages.VerdictMessage(
            lease=0, configuration_version=0, beat_period_ms=1000, reason=Refusal.BLOCKED
        )
        (verdict, (key, is_answer, helps, _)) = desk.claim(1, "ABCD")
        assert (verdict, key, is_answer) == (answer(1, refused), 1, False)
        assert helps == help_message("blocked: broken; `msbot unblock ABCD` lets it in again")
        assert desk.claim(1, "ABCD") == [answer(1, refused)], "what helps is said once"
        told = desk.service.told_unasked
        del desk.rig.store.blocks[uid(1)]
        ((key, is_answer, given, _),) = desk.claim(1, "ABCD")
        assert (key, is_answer) == (1, True)
        assert isinstance(given, pnp_messages.VerdictMessage)
        assert given.lease
        assert desk.service.told_unasked == told

    run_virtual(scene())


def test_a_stranger_is_asked_what_it_is_where_strangers_are_answered() -> None:
    async def scene() -> None:
        for explain in (False, True):
            desk = Desk(explain=explain)
            desk.rig.join(1)
            refused = pnp_messages.VerdictMessage(
                lease=0, configuration_version=0, beat_period_ms=1000, reason=Refusal.UNKNOWN_PART
            )
            asked = [unasked(1, pnp_messages.NoticeKind.DESCRIBE), answer(1, refused)]
            assert desk.claim(1, "NOPE") == (asked if explain else [])
            assert desk.service.told_unasked == int(explain)
            assert desk.ask(1, b"abc") == []
            desk.rig.join(2)
            (verdict,) = desk.claim(2, "ABCD")
            assert verdict[:2] == (2, True)

    run_virtual(scene())


@pytest.mark.parametrize("more", [0, 1])
def test_a_long_answer_goes_reliably_so_that_it_can_be_split(more: int) -> None:
    async def scene() -> None:
        desk = Desk()
        request = pnp_messages.ConfigurationRequest(lease=desk.join(1, "ABCD"), have_version=0)
        size = len(
            pnp_messages.ConfigurationMessage(
                version=1, slot="AA", bindings=[], settings=[pnp_messages.Setting(name="n", value="")]
            ).encode()
        )
        value = "v" * (LONGEST_BEST_EFFORT - size + more)
        desk.rig.store.configurations["AA"] = Configuration(1, "AA", settings=(("n", value),))
        desk.rig.inventory.configuration_changed("AA")
        assert desk.said() == [(1, False, pnp_messages.BeatReply(configuration_version=1), STREAM_BEST_EFFORT)]
        ((_, _, reply, stream),) = desk.ask(1, request)
        assert len(reply.encode()) == LONGEST_BEST_EFFORT + more
        assert stream == (STREAM_RELIABLE if more else STREAM_BEST_EFFORT)

    run_virtual(scene())


def test_a_part_that_joins_while_stop_holds_hears_of_it_with_its_configuration() -> None:
    async def scene() -> None:
        desk = Desk()
        lease = desk.join(1, "ABCD")
        request = pnp_messages.ConfigurationRequest(lease=lease, have_version=0)
        ((_, _, open_robot, _),) = desk.ask(1, request)
        assert isinstance(open_robot, pnp_messages.ConfigurationMessage)
        desk.service.stop_all("ann", "", 0)
        stop = unasked(1, pnp_messages.NoticeKind.STOP, 1)
        assert desk.said() == [stop]
        (held, notice) = desk.ask(1, request)
        assert notice == stop
        assert isinstance(held[2], pnp_messages.ConfigurationMessage)
        open_robot.settings.append(
            pnp_messages.Setting(name=".stop", value="1")
        )  # docs/reference/messages.md, `Setting`
        assert held[:3] == (1, True, open_robot)
        assert desk.service.go_all("ann") == 1
        assert desk.said() == [unasked(1, pnp_messages.NoticeKind.GO, 1)]

    run_virtual(scene())


@pytest.mark.parametrize("is_stored", [True, False])
def test_real_parts_are_told_of_stop_first_and_a_crowd_of_simulated_ones_after_the_answer(
    is_stored: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    async def scene() -> None:
        desk = Desk(explain=True)
        crowd = range(10, 10 + 3 * TOLD_IN_TURN - 1)
        for key in crowd:
            desk.rig.join(key)
            desk.claim(key, "WXYZ")
            record = desk.rig.inventory._index.record_of(key)
            assert record is not None
            assert not desk.rig.inventory.is_simulated(key)
            record.take_nature(pnp_messages.Nature.SIMULATED)
            assert desk.rig.inventory.is_simulated(key)
        desk.join(1, "ABCD")  # it comes last
        assert not desk.rig.inventory.is_simulated(1)
        tell, in_turns = desk.service._tell_some, list[int]()

        def tell_some(notice: pnp_messages.Notice, keys: deque[int]) -> None:
            before = len(keys)
            tell(notice, keys)
            in_turns.append(before - len(keys))

        monkeypatch.setattr(desk.service, "_tell_some", tell_some)
        desk.service.stop_all("ann", "", 0)
        told = desk.said()
        assert [key for key, *_ in told] == [1, *crowd[:TOLD_IN_TURN]]
        if is_stored:
            desk.service.stop_was_stored()
        wait_s = ANSWERED_S if is_stored else LATEST_S
        await asyncio.sleep(0.9 * wait_s)
        assert not desk.said()
        await asyncio.sleep(0.11 * wait_s)
        told += desk.said()
        assert told == [unasked(key, pnp_messages.NoticeKind.STOP, 1) for key in (1, *crowd)]
        assert in_turns == [TOLD_IN_TURN, TOLD_IN_TURN, TOLD_IN_TURN - 1]

        desk.service.stop_all("ann", "", 0)
        desk.service.go_all("ann")  # in the same turn: who has not heard of STOP yet must not hear of it later
        await asyncio.sleep(2 * LATEST_S)
        last = {said[0]: said for said in desk.said()}
        assert last == {key: unasked(key, pnp_messages.NoticeKind.GO, 1) for key in (1, *crowd)}

    run_virtual(scene())


@pytest.mark.parametrize(("before", "after"), TRANSITIONS)
@pytest.mark.parametrize("holds", [True, False])
def test_what_a_change_of_state_means_for_the_stop_that_holds(
    before: PartState | None, after: PartState, holds: bool
) -> None:
    async def scene() -> None:
        desk = Desk()
        lease = desk.join(1, "ABCD")
        if holds:
            desk.service.stop_all("ann", "", 0)
            desk.ask(1, pnp_messages.StoppedBeat(lease=lease, number=1))
            assert desk.stopped() == (["AA"], ())
        event = PartEvent(0.0, "AA", "AA", before, after, "because", identity=uid(1))
        for handler in desk.rig.inventory._changes.event_handlers:
            handler(event)
        expected: tuple[list[str], tuple[str, ...]] = (["AA"], ())
        if after is PartState.ACTIVE and before is not PartState.LATE:
            expected = ([], ("AA",))  # another program, or the same one anew: it has confirmed nothing
        elif after in (PartState.LEFT, PartState.STANDBY, PartState.REFUSED):
            expected = ([], ())  # it drives nothing
        assert desk.stopped() == (expected if holds else ([], ()))

    run_virtual(scene())


def test_go_is_said_with_three_more_beats_and_of_another_requester_nothing_is_remembered() -> None:
    async def scene() -> None:
        desk = Desk()
        lease = desk.join(1, "ABCD")
        beat, answered = pnp_messages.Beat(lease=lease), answer(1, pnp_messages.BeatReply(configuration_version=1))
        go = unasked(1, pnp_messages.NoticeKind.GO, 1)
        desk.service.stop_all("ann", "", 0)
        desk.ask(1, pnp_messages.StoppedBeat(lease=lease, number=1))
        assert desk.stopped() == (["AA"], ())
        assert desk.claim(1, "ABCD", requester=2)[0][1], "the same part, whose program speaks through another requester"
        assert desk.stopped() == ([], ("AA",))
        assert desk.service.go_all("ann") == 1
        assert desk.said() == [go]
        assert [desk.ask(1, beat, requester=2) for _ in range(4)] == [[answered, go]] * 3 + [[answered]]
        desk.rig.store.configurations["AA"] = configuration("AA", version=2)
        desk.rig.inventory.configuration_changed("AA")
        assert desk.said() == [(1, False, pnp_messages.BeatReply(configuration_version=2), STREAM_BEST_EFFORT)]
        desk.ask(1, beat, requester=3)
        desk.rig.inventory.configuration_changed("AA")
        verdict = pnp_messages.VerdictMessage(lease=lease, configuration_version=2, beat_period_ms=1000)
        assert desk.said() == [(1, False, verdict, STREAM_BEST_EFFORT)], "it was not told its lease yet"

    run_virtual(scene())


def test_whose_session_was_opened_anew_is_forgotten_with_all_that_it_was_to_be_told() -> None:
    async def scene() -> None:
        desk = Desk()
        desk.join(1, "ABCD")
        desk.join(2, "EFGH")
        desk.service.stop_all("ann", "", 0)
        desk.service.go_all("ann")
        assert sorted(desk.service._go_again) == [1, 2]
        desk.rig.join(1)
        service = desk.service
        assert [sorted(kept) for kept in (service._askers, service._leases, service._go_again)] == [[2]] * 3
        assert not desk.service.identify(1)
        desk.said()
        assert desk.service.identify(2)
        assert desk.said() == [unasked(2, pnp_messages.NoticeKind.IDENTIFY)]

    run_virtual(scene())


def test_what_finds_no_room_was_not_said() -> None:
    async def scene() -> None:
        desk = Desk()
        lease = desk.join(1, "ABCD")
        desk.mouth.is_full = True
        assert not desk.service.identify(1)
        assert desk.ask(1, pnp_messages.Beat(lease=lease)) == []
        assert desk.service.requests.dropped == {"answer: the stream is full": 2}
        desk.mouth.is_full = False
        assert desk.ask(1, pnp_messages.Beat(lease=lease)) == [
            answer(1, pnp_messages.BeatReply(configuration_version=1))
        ]

    run_virtual(scene())


def test_a_request_from_elsewhere_is_answered_like_one_from_here() -> None:
    async def scene() -> None:
        desk = Desk()
        desk.rig.join(1)
        identity = guid(9, 5) + (77).to_bytes(8, "big")  # of the agent there: another key
        body = thesis_messages.encode_request("ABCD", "eye")
        desk.service.request_from_elsewhere(1, in_compat=True, identity=identity, body=body)
        assert desk.said() == [answer(9, "ABCD")]
        assert desk.rig.part(1).local_name == "eye"
        desk.rig.join(2)
        claim = pnp_messages.ClaimMessage(part_number="EFGH", local_name="", uid=uid(2), session_nonce=1)
        desk.service.request_from_elsewhere(2, in_compat=False, identity=identity, body=claim.encode())
        ((key, is_answer, verdict, _),) = desk.said()
        assert (key, is_answer, type(verdict)) == (9, True, pnp_messages.VerdictMessage)

    run_virtual(scene())


def test_it_is_ready_when_it_is_connected_and_everything_was_made() -> None:
    async def scene() -> None:
        desk = Desk()
        await desk.service.until_ready(2.5)
        assert desk.mouth.waited == [("connect", 2.5), ("all", 2.5)]

    run_virtual(scene())


def test_a_timer_that_is_due_sooner_than_it_was_wakes_the_inventory() -> None:
    async def scene() -> None:
        desk = Desk()
        keeping = asyncio.create_task(desk.service._keep_time())
        await asyncio.sleep(0.1)
        inventory = desk.rig.inventory
        for key in (1, 2):  # the second one is a rival: whether the first still lives is asked at once
            inventory.client_joined(key, f"peer {key}", 0.1, client_key=5, patience_s=0.2)
            inventory.claim(Claim("ABCD", uid=uid(1), nonce=key), key, 0.1)
        assert inventory.timer() == pytest.approx(0.3)
        desk.ask(1, b"abc")
        await asyncio.sleep(0.25)
        assert desk.rig.state(2) is PartState.ACTIVE
        keeping.cancel()

    run_virtual(scene())
