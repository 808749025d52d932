"""When the samples of a replay are due."""

from hypothesis import given
from hypothesis import strategies as st

from msbot.recording.replay.schedule import NS, Schedule

TIMES = st.lists(st.integers(0, 100 * NS), min_size=1, max_size=30).map(sorted)
SPEEDS = st.floats(0.01, 1000.0)


def play(schedule: Schedule, now: float, until: float = float("inf")) -> list[tuple[float, int]]:
    """Do everything that is due, at the moments that the timer names."""
    done = []
    while (at := schedule.timer()) is not None and max(at, now) <= until:
        now = max(now, at)
        index = schedule.due(now)
        assert index is not None, "the timer names a moment at which something is due"
        done.append((now, index))
        schedule.done()
    return done


@given(TIMES, SPEEDS, st.integers(0, 10 * NS), st.floats(0, 1e6))
def test_every_sample_is_due_once_in_order_and_at_its_time(
    times: list[int], speed: float, early_ns: int, now: float
) -> None:
    begin_ns = times[0] - early_ns
    schedule = Schedule(times, begin_ns=begin_ns, speed=speed)
    assert schedule.timer() is None, "it is held at first"
    schedule.go(now)
    done = play(schedule, now)
    assert [index for _, index in done] == list(range(len(times)))
    for at, index in done:
        assert abs((at - now) * speed - (times[index] - begin_ns) / NS) < 1e-6 * speed
    assert schedule.ended
    assert schedule.timer() is None


@given(TIMES, SPEEDS, st.lists(st.tuples(st.floats(0, 20), st.floats(0, 20)), max_size=6))
def test_a_pause_moves_what_comes_after_it_and_nothing_else(
    times: list[int], speed: float, pauses: list[tuple[float, float]]
) -> None:
    schedule = Schedule(times, begin_ns=times[0], speed=speed)
    now, paused, done = 0.0, 0.0, []
    for going, pause in pauses:
        schedule.go(now)
        done += [(at - paused, index) for at, index in play(schedule, now, now + going)]
        now += going
        schedule.hold(now)
        assert schedule.timer() is None
        assert schedule.due(now + pause) is None, "nothing is due while it is held"
        now += pause
        paused += pause
    schedule.go(now)
    done += [(at - paused, index) for at, index in play(schedule, now)]
    assert [index for _, index in done] == list(range(len(times)))
    for at, index in done:
        assert abs(at - (times[index] - times[0]) / NS / speed) < 1e-4


@given(TIMES, st.floats(0.001, 50))
def test_what_was_overdue_when_it_was_held_is_due_at_once_and_what_follows_keeps_its_distance(
    times: list[int], late_s: float
) -> None:
    schedule = Schedule(times, begin_ns=times[0])
    schedule.go(0.0)
    schedule.hold(late_s)  # nobody has looked meanwhile: the first sample is overdue
    schedule.go(1000.0)
    done = play(schedule, 1000.0)
    assert done[0] == (1000.0, 0)
    assert all(abs(at - 1000.0 - (times[index] - times[0]) / NS) < 1e-6 for at, index in done)


def test_go_and_hold_said_twice_change_nothing() -> None:
    schedule = Schedule([0, NS], begin_ns=0)
    schedule.go(5.0)
    schedule.go(5.5)
    assert schedule.timer() == 5.0
    schedule.done()
    assert schedule.timer() == 6.0
    schedule.hold(5.25)
    schedule.hold(5.75)
    schedule.go(10.0)
    assert schedule.timer() == 10.75
