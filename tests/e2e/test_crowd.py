"""Many parts switched on together on one CAN bus: they come in one after the other, and none is lost meanwhile."""

from __future__ import annotations

from pathlib import Path

import pytest

from bench.buses import Rates
from bench.crowd import Outcome, start_anew, switch_on
from msbot.process.virtual_time import run_virtual
from msbot_agent.link.can.native_link import NO_ADDRESS
from msbot_agent.link.can.protocol.join_master import LISTEN_S


def outcome(rates: Rates, size: int, folder: Path, *, rest_s: float = 0.0, seed: int = 1) -> Outcome:
    return checked(run_virtual(switch_on(rates, size, folder, rest_s=rest_s, seed=seed)), size)


def checked(found: Outcome, size: int) -> Outcome:
    assert len(found.active_s) == size
    assert (found.lost, found.late, found.dropped) == (0, 0, {})
    assert (found.frames["JOIN"], found.frames["ASSIGN"]) == (size, size), "everybody asks once"
    assert found.frames["TAKEN BACK"] == 0
    assert found.ratio < 1.3
    return found


@pytest.mark.parametrize(
    ("rates", "size", "limit_s"), [(Rates(50_000), 48, 12.0), (Rates(500_000, 2_000_000), 40, 0.3)]
)  # the slow one: as many bits a second for each as 120 have at 125 kbit/s, in a quarter of the processor time
def test_many_parts_at_once(rates: Rates, size: int, limit_s: float, tmp_path: Path) -> None:
    assert outcome(rates, size, tmp_path).last_s < limit_s


def test_120_parts_at_500_kbit_s_at_once_and_at_rest(tmp_path: Path) -> None:
    found = outcome(Rates(500_000), 120, tmp_path, rest_s=2.5, seed=2)
    assert found.last_s < 3.0
    assert found.load < 0.08


def test_one_part_needs_the_time_of_its_frames(tmp_path: Path) -> None:
    found = outcome(Rates(500_000), 1, tmp_path)
    assert found.last_s < 0.008
    assert found.ratio == pytest.approx(1.0, abs=0.02)


def test_a_master_that_is_started_anew_gets_its_parts_back(tmp_path: Path) -> None:
    again = run_virtual(start_anew(Rates(125_000), 20, tmp_path))
    # While the new master listens whether it is alone, parts still beat from the addresses of the old one's epoch.
    assert again.dropped.keys() <= {NO_ADDRESS}
    again.dropped.clear()
    # One that has not heard of the new epoch yet is told that its address is not its own any more.
    assert again.frames.pop("TAKEN BACK", 0) <= 20
    checked(again, 20)
    assert again.last_s < 1.5 + LISTEN_S
