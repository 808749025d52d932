"""What the benchmark of hours says about memory: the warm-up does not count, a leak does."""

import pytest

from bench.hours import Look, growth


def look(minute: int, master_mb: float, recorder_mb: float = 20.0) -> Look:
    return Look(60.0 * minute, master_mb, recorder_mb, 0.05, 100, 1.0)


def test_the_warm_up_does_not_count() -> None:
    words = growth([look(0, 60.0), look(10, 90.0), *(look(minute, 100.0) for minute in range(20, 130, 10))])
    assert words.startswith("After the warm-up, the first 20 minutes: the master 100.0 to 100.0 MB")
    assert "(+0.00 MB an hour); the recorder 20.0 to 20.0 MB" in words


@pytest.mark.parametrize("mb_per_hour", [6.0, -3.0])
def test_what_grows_is_told_with_its_rate(mb_per_hour: float) -> None:
    looks = [look(minute, 100.0, 20.0 + mb_per_hour * minute / 60) for minute in range(0, 130, 10)]
    words = growth(looks)
    assert "the master 100.0 to 100.0 MB, at most 100.0 (+0.00 MB an hour)" in words
    assert words.endswith(f"({mb_per_hour:+.2f} MB an hour).")
