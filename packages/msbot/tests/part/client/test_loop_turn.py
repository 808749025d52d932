"""One piece of work per loop turn, one timer, and waiting for news."""

import asyncio

import pytest

from msbot.part.client.client_settings import ChangeNotifier, WorkScheduler
from msbot.process.virtual_time import run_virtual
from msbot_xrce.errors import RequestError


def test_work_is_done_once_per_turn_however_often_it_was_booked() -> None:
    async def main() -> list[float]:
        done: list[float] = []
        turn = WorkScheduler(done.append)
        turn.schedule()
        await asyncio.sleep(0)
        assert done == []
        turn.start(asyncio.get_running_loop())
        turn.schedule()
        turn.schedule()
        await asyncio.sleep(1.0)
        turn.schedule()
        await asyncio.sleep(0)
        turn.cancel()
        turn.schedule()
        await asyncio.sleep(0)
        return done

    assert run_virtual(main()) == [0.0, 1.0]


def test_work_that_was_booked_before_the_stop_is_not_done_after_it() -> None:
    async def main() -> list[float]:
        done: list[float] = []
        turn = WorkScheduler(done.append)
        turn.start(asyncio.get_running_loop())
        turn.cancel()
        await asyncio.sleep(0)
        return done

    assert run_virtual(main()) == []


def test_the_timer_is_the_earliest_of_the_last_times_given() -> None:
    async def main() -> list[float]:
        done: list[float] = []
        turn = WorkScheduler(done.append)
        turn.start(asyncio.get_running_loop())
        await asyncio.sleep(0)
        turn.set_timer(5.0, None, 2.0)
        turn.set_timer(3.0, 4.0)
        turn.set_timer(4.0, 3.0)
        await asyncio.sleep(3.5)
        turn.set_timer(4.0)
        turn.set_timer(None, None)
        await asyncio.sleep(3.5)
        turn.set_timer(8.0)
        turn.cancel()
        await asyncio.sleep(3.5)
        return done

    assert run_virtual(main()) == [0.0, 3.0]


def test_time_is_the_loops() -> None:
    async def main() -> None:
        turn = WorkScheduler(lambda _: None)
        assert turn.now() == 0.0
        await asyncio.sleep(1.5)
        turn.start(asyncio.get_running_loop())
        assert turn.now() == 1.5

    run_virtual(main())


def test_waiters_look_again_at_news_and_give_up_in_words() -> None:
    async def main() -> None:
        news = ChangeNotifier()
        news.tell()
        happened: list[int] = []
        waiting = [
            asyncio.create_task(news.until(lambda: len(happened) >= 1, None, "x")),
            asyncio.create_task(news.until(lambda: len(happened) >= 2, None, "x")),
        ]
        await asyncio.sleep(0.1)
        happened.append(1)
        news.tell()
        await asyncio.sleep(0.1)
        assert [task.done() for task in waiting] == [True, False]
        happened.append(2)
        news.tell()
        await asyncio.sleep(0.1)
        assert waiting[1].done()
        with pytest.raises(RequestError, match=r"it did not happen within 0\.5 s"):
            await news.until(lambda: False, 0.5, "it did not happen")

    run_virtual(main())


def test_a_timer_that_is_put_off_again_and_again_comes_once_at_the_last_time_given() -> None:
    async def main() -> list[float]:
        done: list[float] = []
        turn = WorkScheduler(done.append)
        turn.start(asyncio.get_running_loop())
        await asyncio.sleep(0)
        done.clear()
        for later in range(5):
            turn.set_timer(10.0 + later, None)
        await asyncio.sleep(20.0)
        turn.set_timer(30.0)
        turn.set_timer(None)
        await asyncio.sleep(20.0)
        return done

    assert run_virtual(main()) == [14.0]
