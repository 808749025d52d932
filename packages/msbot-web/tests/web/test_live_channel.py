"""What is live on pages: one look for all, changes only, nothing for hidden tabs, and nothing for other people."""

from __future__ import annotations

import asyncio
import json
import zlib
from collections.abc import Callable, Coroutine
from itertools import pairwise
from typing import Any, cast

import pytest
from starlette.websockets import WebSocket

from msbot.operations.rights import Role
from msbot.process.virtual_time import VirtualTimeLoop, run_virtual
from msbot_web.access.accounts import Accounts
from msbot_web.access.sessions import Session
from msbot_web.access.users import MemoryUsers
from msbot_web.live_channel import (
    ALIVE,
    ALIVE_S,
    LONGEST_PAUSE_S,
    LOOK_S,
    MORE_S,
    NONSENSE,
    NOT_THERE,
    NUDGED_S,
    OVER,
    PIECES_IN_TURN,
    SEND_S,
    SHARE,
    LiveChannel,
    LiveView,
)
from msbot_web.part_websocket import PACKETS

MORE_STATE: dict[str, object] = {}
"""What else a connection's state has."""


class Browser:
    """A browser's end of the WebSocket."""

    def __init__(self, session: Session, page: str, *, unpacks: bool = False) -> None:
        self.packed: list[bytes] = []
        self.scope = {"state": {"session": session, **MORE_STATE}}
        self.query_params = {"page": page, "packed": "1" if unpacks else "0"}
        self.heard: list[str] = []
        self.closed: int | None = None
        self.reads = asyncio.Event()
        self.reads.set()
        self._says: asyncio.Queue[dict[str, str]] = asyncio.Queue()

    async def accept(self) -> None:
        """Let it in."""

    async def receive(self) -> dict[str, str]:
        return await self._says.get()

    async def send_text(self, text: str) -> None:
        await self.reads.wait()
        self.heard.append(text)

    async def send_bytes(self, octets: bytes) -> None:
        await self.reads.wait()
        self.packed.append(octets)
        self.heard.append(zlib.decompress(octets).decode())

    async def close(self, code: int) -> None:
        self.closed = code

    def say(self, text: str) -> None:
        self._says.put_nowait({"type": "websocket.receive", "text": text})

    def go(self) -> None:
        self._says.put_nowait({"type": "websocket.disconnect"})

    @property
    def news(self) -> list[dict[str, Any]]:
        """What it has heard but that the robot is there."""
        return [json.loads(text)["cards"] for text in self.heard if text != ALIVE]


class OpenPage:
    """A page as the channel sees it."""

    is_connected = True

    def __init__(self, session: Session) -> None:
        self.session = session
        self.refreshed = 0
        self.checked = 0
        self.fails = False

    def refresh(self) -> None:
        self.refreshed += 1
        if self.fails:
            raise ValueError("a mistake of a page")

    def check_session(self) -> None:
        self.checked += 1


class Stage:
    """A channel with a robot of two cards."""

    def __init__(self) -> None:
        self.accounts = Accounts(MemoryUsers(), clock=asyncio.get_running_loop().time)
        self.channel = LiveChannel(self.accounts)
        self.session = self.sign_in("ada")
        self.values: dict[str, int] = {"knob": 1, "fan": 1}
        self.drawn: list[str] = []
        self._tasks: list[asyncio.Task[None]] = [asyncio.create_task(self.channel.run())]

    def sign_in(self, name: str) -> Session:
        return self.accounts.sessions.begin(name, Role.TEACHER, is_lasting=True)

    def _make(self) -> LiveView:
        def piece(name: str) -> object:
            self.drawn.append(name)
            return self.values[name]

        return LiveView("cards", lambda: self.values, piece)

    async def open(
        self, number: str, session: Session | None = None, *, unpacks: bool = False
    ) -> tuple[OpenPage, Browser]:
        page = OpenPage(self.session)
        self.channel.add(number, page)
        browser = Browser(session or self.session, number, unpacks=unpacks)
        self._tasks.append(asyncio.create_task(self.channel.serve(cast("WebSocket", browser))))
        await asyncio.sleep(0.01)
        self.channel.show(number, "all", self._make)
        return page, browser

    def end(self) -> None:
        for task in self._tasks:
            task.cancel()


def on_stage(play: Callable[[Stage], Coroutine[Any, Any, None]]) -> None:
    async def main() -> None:
        stage = Stage()
        try:
            await play(stage)
        finally:
            stage.end()

    run_virtual(main())


def test_all_hear_the_whole_once_and_then_changes_which_are_worked_out_once() -> None:
    async def play(stage: Stage) -> None:
        browsers = [(await stage.open(f"page {number}"))[1] for number in range(30)]
        await asyncio.sleep(0.6)
        assert [browser.news for browser in browsers] == [[{"knob": 1, "fan": 1}]] * 30
        stage.drawn.clear()
        stage.values["fan"] = 2
        await asyncio.sleep(0.6)
        assert {json.dumps(browser.news[1:]) for browser in browsers} == {'[{"fan": 2}]'}
        assert stage.drawn == ["fan"]
        _, late = await stage.open("a late page")
        await asyncio.sleep(0.6)
        assert late.news == [{"knob": 1, "fan": 2}]
        del stage.values["knob"]
        stage.channel.again("a late page")
        await asyncio.sleep(0.6)
        assert late.news[1:] == [{"fan": 2}]

    on_stage(play)


def test_long_news_are_packed_once_for_all_who_can_unpack_them() -> None:
    async def play(stage: Stage) -> None:
        stage.values.update({f"slot {number}": number for number in range(200)})
        plain, *packed = [(await stage.open(f"page {number}", unpacks=number > 0))[1] for number in range(3)]
        await asyncio.sleep(0.6)
        assert plain.news == packed[0].news == packed[1].news == [stage.values]
        assert plain.packed == []
        assert len(packed[0].packed[0]) < len(plain.heard[0]) / 2
        assert packed[0].packed[0] is packed[1].packed[0]
        stage.values["fan"] = 5
        await asyncio.sleep(0.6)
        assert packed[0].news[1:] == [{"fan": 5}]
        assert len(packed[0].packed) == 1  # short ones are not worth it

    on_stage(play)


def test_what_the_connection_takes_at_once_needs_no_task(monkeypatch: pytest.MonkeyPatch) -> None:
    async def play(stage: Stage) -> None:
        heard: list[bytes | str] = []
        has_room = True

        class Carrier:
            def send_packet(self, packet: bytes | str) -> bool:
                heard.extend([packet] if has_room else [])
                return has_room

        monkeypatch.setitem(MORE_STATE, PACKETS, Carrier())
        _, browser = await stage.open("ann", unpacks=True)
        await asyncio.sleep(3)
        assert ALIVE in heard
        assert {"cards": {"knob": 1, "fan": 1}} in [json.loads(one) for one in heard if one != ALIVE]
        assert browser.heard == []
        has_room, count = False, len(heard)
        await asyncio.sleep(3)
        assert len(heard) == count
        assert ALIVE in browser.heard

    on_stage(play)


def test_who_hears_nothing_new_hears_that_the_robot_is_there() -> None:
    async def play(stage: Stage) -> None:
        _, browser = await stage.open("page")
        await asyncio.sleep(10.0)
        assert 9 <= browser.heard.count(ALIVE) <= 11

    on_stage(play)


def test_a_late_loop_looks_after_pages_less_often_and_still_says_that_the_robot_is_there() -> None:
    async def play(stage: Stage) -> None:
        loop = asyncio.get_running_loop()
        assert isinstance(loop, VirtualTimeLoop)
        page, browser = await stage.open("page")
        await asyncio.sleep(2.0)
        usual = page.refreshed
        ends_at = loop.time() + 30.0
        while loop.time() < ends_at:  # whatever is due comes late: something else works for 0.15 s at a time
            loop._set_clock(loop.time() + 0.15)
            await asyncio.sleep(0.001)
        assert page.refreshed - usual <= 30.0 / LOOK_S / 2
        assert browser.heard.count(ALIVE) >= 30.0 / ALIVE_S / 2
        await asyncio.sleep(3 * LONGEST_PAUSE_S)
        usual = page.refreshed
        await asyncio.sleep(10.0)
        assert page.refreshed - usual >= 10.0 / LOOK_S - 1

    on_stage(play)


def test_much_that_has_changed_is_written_down_piece_by_piece_and_sent_at_once() -> None:
    async def play(stage: Stage) -> None:
        _, browser = await stage.open("page")
        await asyncio.sleep(0.6)
        looks: list[int] = []
        many = {f"slot {number}": number for number in range(100)}
        stage.values.update(many)

        stage.channel.nudge()
        await asyncio.sleep(MORE_S / 10)
        for _ in range(30):
            looks.append(len(stage.drawn))
            await asyncio.sleep(MORE_S / 2)
        assert looks[-1] == 102
        steps = [after - before for before, after in pairwise(looks)]
        assert max(steps) == PIECES_IN_TURN
        assert not any(a and b for a, b in pairwise(steps))  # others have their turn between two of them
        assert browser.news == [{"knob": 1, "fan": 1}, many]

    on_stage(play)


def test_pages_take_a_part_of_the_time_however_much_they_have_to_do() -> None:
    async def play(stage: Stage) -> None:
        loop = asyncio.get_running_loop()
        assert isinstance(loop, VirtualTimeLoop)
        page, _ = await stage.open("page")

        class Slow(OpenPage):
            def refresh(self) -> None:
                super().refresh()
                assert isinstance(loop, VirtualTimeLoop)
                loop._set_clock(loop.time() + 0.1)

        slow = Slow(stage.session)
        stage.channel.add("slow", slow)
        began = loop.time()
        await asyncio.sleep(40.0)
        assert slow.refreshed * 0.1 <= (loop.time() - began) * SHARE + 0.1
        assert page.refreshed > 0

    on_stage(play)


def test_a_hidden_tab_is_told_nothing_and_its_page_is_not_refreshed_until_it_is_seen_again() -> None:
    async def play(stage: Stage) -> None:
        page, browser = await stage.open("page")
        await asyncio.sleep(0.6)
        browser.say("hidden")
        await asyncio.sleep(0.1)
        refreshed, heard = page.refreshed, len(browser.heard)
        stage.values["fan"] = 3
        await asyncio.sleep(60.0)
        assert (page.refreshed, len(browser.heard)) == (refreshed, heard)
        browser.say("shown")
        await asyncio.sleep(0.05)
        assert page.refreshed == refreshed + 1
        assert browser.news[-1]["fan"] == 3

    on_stage(play)


def test_what_was_done_is_told_soon_but_first_it_reaches_the_parts() -> None:
    async def play(stage: Stage) -> None:
        _, browser = await stage.open("page")
        await asyncio.sleep(0.6)
        stage.values["knob"] = 9
        drawn = len(stage.drawn)
        stage.channel.nudge()
        await asyncio.sleep(NUDGED_S / 2)
        assert len(stage.drawn) == drawn
        stage.values["fan"] = 8
        stage.channel.nudge()
        await asyncio.sleep(NUDGED_S / 2 + 0.01)
        assert browser.news[-1] == {"knob": 9, "fan": 8}

    on_stage(play)


def test_nobody_else_hears_a_page_and_its_person_no_longer_than_signed_in() -> None:
    async def play(stage: Stage) -> None:
        _, own = await stage.open("page")
        stranger = Browser(stage.sign_in("eve"), "page")
        nowhere = Browser(stage.session, "no page")
        for browser in (stranger, nowhere):
            await stage.channel.serve(cast("WebSocket", browser))
            assert (browser.closed, browser.heard) == (NOT_THERE, [])
        await asyncio.sleep(0.6)
        assert own.closed is None
        assert own.news
        stage.accounts.sessions.end(stage.session)
        await asyncio.sleep(0.01)
        assert own.closed == OVER

    on_stage(play)


@pytest.mark.parametrize("text", ["", "hello", '{"view": "cards"}'])
def test_what_no_page_of_ours_says_ends_the_connection(text: str) -> None:
    async def play(stage: Stage) -> None:
        page, browser = await stage.open("page")
        browser.say(text)
        await asyncio.sleep(0.01)
        assert browser.closed == NONSENSE
        await asyncio.sleep(0.6)
        assert page.refreshed, "the page is drawn by NiceGUI"
        assert not stage.channel.show("page", "all", stage._make)

    on_stage(play)


def test_who_reads_slowly_gets_the_whole_later_and_holds_up_nobody() -> None:
    async def play(stage: Stage) -> None:
        _, slow = await stage.open("slow")
        _, quick = await stage.open("quick")
        await asyncio.sleep(0.6)
        slow.reads.clear()
        for value in range(5):
            stage.values["fan"] = 10 + value
            await asyncio.sleep(0.5)
        assert [news["fan"] for news in quick.news[1:]] == [10, 11, 12, 13, 14]
        slow.reads.set()
        await asyncio.sleep(0.6)
        assert slow.news[-1] == {"knob": 1, "fan": 14}
        slow.reads.clear()
        stage.values["fan"] = 20
        await asyncio.sleep(SEND_S + 2)
        assert slow.closed is not None
        assert quick.closed is None

    on_stage(play)


def test_a_page_that_fails_is_said_and_the_others_are_refreshed(caplog: pytest.LogCaptureFixture) -> None:
    async def play(stage: Stage) -> None:
        broken, _ = await stage.open("broken")
        sound, _ = await stage.open("sound")
        broken.fails = True
        await asyncio.sleep(4.0)
        assert sound.refreshed >= 6
        assert sound.checked >= 1

    on_stage(play)
    assert "a page could not be refreshed" in caplog.text


def test_what_moves_is_looked_at_ten_times_a_second_and_pages_are_refreshed_twice() -> None:
    async def play(stage: Stage) -> None:
        page, browser = await stage.open("page")

        def time() -> dict[str, float]:
            return {"time": round(asyncio.get_running_loop().time(), 3)}

        view = LiveView("cards", time, lambda name: time()[name], is_quick=True)
        stage.channel.show("page", "moving", lambda: view)
        await asyncio.sleep(1.0)
        browser.heard.clear()
        refreshed = page.refreshed
        await asyncio.sleep(10.0)
        assert 98 <= len(browser.news) <= 102
        assert 19 <= page.refreshed - refreshed <= 21

    on_stage(play)


def test_a_view_that_nobody_looks_at_is_forgotten_and_not_worked_out() -> None:
    async def play(stage: Stage) -> None:
        _, browser = await stage.open("page")
        await asyncio.sleep(0.6)
        browser.go()
        await asyncio.sleep(0.1)
        stage.drawn.clear()
        stage.values["fan"] = 5
        await asyncio.sleep(2.0)
        assert not stage.drawn
        stage.channel.remove("page")
        stage.channel.remove("page")

    on_stage(play)
