"""What a writer in Zenoh repeats while it has nothing to write, in virtual time and without the library."""

from __future__ import annotations

import asyncio

from msbot.process.virtual_time import run_virtual
from msbot_agent.space import Qos
from msbot_agent.space.zenoh.sample_envelope import read_envelope
from msbot_agent.space.zenoh.zenoh_writer import LibraryWriter


def sent_by(
    acts: list[tuple[float, int]], *, qos: Qos, closed_at: float | None = None
) -> list[tuple[float, int, bool]]:
    """Moment, number, and whether it was a repetition, of all that a writer sends which writes these numbers then."""
    sent: list[tuple[float, int, bool]] = []

    async def main() -> None:
        loop = asyncio.get_running_loop()

        def put(_: bytes, *, attachment: bytes) -> None:
            envelope = read_envelope(attachment)
            assert envelope is not None
            sent.append((loop.time(), envelope.number, envelope.is_repeated))

        outlet = LibraryWriter(loop, "", 0, "rt/light", "Light", qos, bytes(16), outward=None, is_request=False)
        outlet.is_wanted = True
        outlet._opened(put)
        for moment, number in acts:
            loop.call_at(moment, outlet.write, b"sample", number)
        if closed_at is not None:
            loop.call_at(closed_at, outlet.close)
        await asyncio.sleep(1000.0)

    run_virtual(main())
    return sent


RELIABLE = Qos(depth=64)


def test_the_last_sample_is_repeated_more_and_more_seldom_and_then_no_more() -> None:
    # The first look, after 1 s, sees that something was written; the second that nothing was since.
    assert sent_by([(0.5, 1), (0.75, 2)], qos=RELIABLE) == [
        (0.5, 1, False),
        (0.75, 2, False),
        (2.5, 2, True),
        (4.5, 2, True),
        (8.5, 2, True),
        (16.5, 2, True),
    ]


def test_a_new_sample_takes_its_place() -> None:
    assert sent_by([(0.0, 1), (5.0, 2)], qos=RELIABLE) == [
        (0.0, 1, False),
        (2.0, 1, True),
        (4.0, 1, True),
        (5.0, 2, False),
        (7.0, 2, True),
        (9.0, 2, True),
        (13.0, 2, True),
        (21.0, 2, True),
    ]


def test_who_goes_on_writing_repeats_nothing() -> None:
    acts = [(number * 0.9, number) for number in range(1, 100)]
    assert [number for _, number, is_repeated in sent_by(acts, qos=RELIABLE, closed_at=90.0) if is_repeated] == []


def test_a_closed_writer_and_one_of_best_effort_repeat_nothing() -> None:
    assert sent_by([(0.0, 1)], qos=RELIABLE, closed_at=2.5) == [(0.0, 1, False), (2.0, 1, True)]
    assert sent_by([(0.0, 1)], qos=Qos(reliable=False, depth=64)) == [(0.0, 1, False)]
