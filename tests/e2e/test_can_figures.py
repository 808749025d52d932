"""The goals of docs/evidence.md, as far as they need no crowd of parts."""

from __future__ import annotations

import pytest

from bench.buses import BUSES, Rates, bits
from bench.can_costs import BEAT, LARGE, MESSAGES, THESIS_BEAT, frames_of
from bench.can_setup import CLASSIC, COMPRESSED, THESIS, XML, set_up
from msbot.process.virtual_time import run_virtual


def test_a_heartbeat_is_one_classic_frame_each_way_and_a_twentieth_of_the_thesis() -> None:
    beat = frames_of(BEAT, "classic, compressed")
    assert len(beat) == 2
    assert sum(bits(beat)) < sum(bits(frames_of(THESIS_BEAT, "thesis"))) / 19


def test_a_sample_of_4_bytes_is_one_frame_in_either_direction() -> None:
    for _, packets in MESSAGES[1:3]:
        assert len(frames_of(packets, "classic, compressed")) == 1


def test_the_message_of_418_bytes_takes_no_more_than_5_percent_above_its_60_frames() -> None:
    ours, least = frames_of(LARGE, "classic"), frames_of(LARGE, "thesis")
    assert len(ours) == len(least) == 60
    assert sum(bits(ours)) < 1.05 * sum(bits(least))


@pytest.mark.parametrize(
    ("rates", "framing", "frames"),
    [
        *((rates, THESIS, 98) for rates in BUSES if not rates.fd),
        *((rates, CLASSIC, 24 if rates.fd else 116) for rates in BUSES),
        *((rates, COMPRESSED, 19 if rates.fd else 47) for rates in BUSES),
    ],
)
def test_the_set_up_succeeds_at_the_first_try_at_every_bit_rate(rates: Rates, framing: str, frames: int) -> None:
    done = run_virtual(set_up(rates, framing))
    assert (done.logins, done.statuses) == (1, len(XML))
    assert done.seconds < 0.2
    assert done.frames <= frames, "nothing is sent twice"
