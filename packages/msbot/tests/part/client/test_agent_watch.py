"""When a client pings, and when it gives up."""

from msbot.part.client.connection import Stall, Watch, WatchStep


def watch() -> Watch:
    made = Watch(quiet_s=2.0, ping_s=0.25, pings=2)
    made.start(10.0)
    return made


def test_it_is_off_until_started() -> None:
    made = Watch(quiet_s=2.0, ping_s=0.25, pings=2)
    made.agent_heard(1.0)
    made.check(1.0)
    assert made.timer() is None
    assert made.step(100.0) is None


def test_a_talking_agent_is_left_alone() -> None:
    made = watch()
    made.agent_heard(11.5)
    assert made.step(12.5) is None
    assert made.timer() == 13.5


def test_a_silent_agent_is_pinged_and_given_up() -> None:
    made = watch()
    assert made.step(12.0) is WatchStep.PING
    assert made.step(12.1) is None
    assert made.step(12.25) is WatchStep.PING
    assert made.step(12.5) is WatchStep.GIVE_UP
    assert made.timer() is None


def test_suspicion_pings_at_once_but_not_twice() -> None:
    made = watch()
    made.check(10.5)
    assert made.step(10.5) is WatchStep.PING
    made.check(10.6)
    assert made.step(10.6) is None
    assert made.timer() == 10.75


def test_any_answer_ends_the_suspicion() -> None:
    made = watch()
    made.check(10.5)
    made.step(10.5)
    made.agent_heard(10.6)
    assert made.step(10.75) is None
    assert made.timer() == 12.6


def test_stopped_it_says_nothing() -> None:
    made = watch()
    made.cancel()
    assert made.step(100.0) is None


def test_waiting_without_progress_is_a_stall() -> None:
    stall = Stall(5.0)
    assert stall.waits(10.0) == 15.0
    assert stall.waits(14.0) == 15.0
    stall.progress()
    assert stall.waits(14.5) == 19.5
