"""Quick checks of a CAN bus with two controllers on it, as the thesis first did them (4.2.1 to 4.2.3; T1 to T4)."""

from __future__ import annotations

import asyncio
import contextlib
from collections import deque
from collections.abc import Awaitable, Callable
from typing import Final

from msbot_agent.link.can.controller import CanBus
from msbot_agent.link.can.protocol.frames import Frame
from msbot_xrce.counting import amount
from msbot_xrce.lazy import dataclass

CAN_ID: Final = 0x321
A: Final = b"\xa5"
"""What the first controller sends (thesis 4.2.2)."""
B: Final = b"\x5a"
"""What the second one sends."""
PATIENCE_S: Final = 1.0
"""A frame that has not come within this time is lost."""
POLL_S: Final = 0.001
OTHER_ID: Final = 0x322
"""The other controller's identifier when both send at once: each needs its own."""


@dataclass(frozen=True, slots=True)
class CheckResult:
    """The result of one check."""

    name: str
    passed: bool
    words: str
    """What was done, or what went wrong."""


async def selftest(one: CanBus, other: CanBus, *, frames: int = 1000) -> list[CheckResult]:
    """Run all checks with two controllers on one bus, `frames` frames each; nobody else may use CAN_ID and OTHER_ID.

    Raises:
        LinkDown: a controller cannot be opened.
    """
    ends = _End(one), _End(other)
    checks: list[tuple[str, Callable[[_End, _End, int], Awaitable[str]]]] = [
        ("every frame that is sent is received, without a pause", _check_stream),
        ("two controllers in turn, polled", _check_polling),
        ("two controllers in turn, each frame answered at once", _check_events),
        ("both at once under full load, each in order", _check_order),
    ]
    results = []
    async with asyncio.TaskGroup() as tasks:
        running = [tasks.create_task(end.bus.run()) for end in ends]
        await asyncio.sleep(0)
        for name, check in checks:
            for end in ends:
                end.clear()
            try:
                results.append(CheckResult(name, True, await check(*ends, frames)))
            except _Failed as failure:
                results.append(CheckResult(name, False, str(failure)))
            await asyncio.sleep(PATIENCE_S / 10)  # frames still on their way belong to this check
        for task in running:
            task.cancel()
    return results


class _Failed(Exception):
    """A check went wrong."""


class _End:
    """One controller, with the frames it heard and those it has still to send."""

    def __init__(self, bus: CanBus) -> None:
        self.bus = bus
        self.heard: list[Frame] = []
        self.answer: Frame | None = None
        """Sent at once for every frame heard."""
        self._waiting: deque[Frame] = deque()
        self._news = asyncio.Event()
        bus.attach(frame=self._frame, room=lambda _now: self._pump())

    def clear(self) -> None:
        """Prepare for another check."""
        self.heard.clear()
        self.answer = None
        self._waiting.clear()

    def send(self, *frames: Frame) -> None:
        """Hand frames over as fast as the controller takes them."""
        self._waiting.extend(frames)
        self._pump()

    async def wait_for(self, count: int) -> None:
        """Wait until this many frames were heard, or none for `PATIENCE_S`."""
        with contextlib.suppress(TimeoutError):
            while len(self.heard) < count:
                self._news.clear()
                await asyncio.wait_for(self._news.wait(), PATIENCE_S)

    def _frame(self, frame: Frame, now: float) -> None:  # noqa: ARG002 - a FrameHandler
        if frame.can_id not in (CAN_ID, OTHER_ID) or frame.extended:
            return
        self.heard.append(frame)
        self._news.set()
        if self.answer is not None:
            self.send(self.answer)

    def _pump(self) -> None:
        while self._waiting and self.bus.has_room():
            self.bus.send(self._waiting.popleft())


async def _check_stream(one: _End, other: _End, count: int) -> str:
    frames = [Frame(CAN_ID, A + number.to_bytes(4, "big")) for number in range(count)]
    one.send(*frames)
    await other.wait_for(count)
    _compare(other.heard, frames)
    return f"{count} frames sent, {count} received"


async def _check_polling(one: _End, other: _End, count: int) -> str:
    for number in range(count):
        for sender, receiver, data in ((one, other, A), (other, one, B)):
            receiver.clear()
            sender.send(Frame(CAN_ID, data))
            for _ in range(int(PATIENCE_S / POLL_S)):
                await asyncio.sleep(POLL_S)
                if receiver.heard:
                    break
            _compare(receiver.heard, [Frame(CAN_ID, data)], number)
    return f"{count} times {A.hex().upper()} and {B.hex().upper()} with identifier {CAN_ID:#x}"


async def _check_events(one: _End, other: _End, count: int) -> str:
    other.answer = Frame(CAN_ID, B)
    for number in range(count):
        one.send(Frame(CAN_ID, A))
        await one.wait_for(number + 1)
        _compare(one.heard, [other.answer] * (number + 1))
    _compare(other.heard, [Frame(CAN_ID, A)] * count)
    return f"{count} questions, {count} answers"


async def _check_order(one: _End, other: _End, count: int) -> str:
    frames = {
        can_id: [Frame(can_id, number.to_bytes(8, "big")) for number in range(count)] for can_id in (CAN_ID, OTHER_ID)
    }
    one.send(*frames[CAN_ID])
    other.send(*frames[OTHER_ID])
    await other.wait_for(count)
    await one.wait_for(count)
    _compare(other.heard, frames[CAN_ID])
    _compare(one.heard, frames[OTHER_ID])
    return f"{count} frames each way at the same time, all in order"


def _compare(heard: list[Frame], sent: list[Frame], number: int = 0) -> None:
    for place, (frame, expected) in enumerate(zip(heard, sent, strict=False), 1):
        if frame != expected:
            if place > 1 and frame == heard[place - 2]:
                raise _Failed(
                    f"frame {number + place - 1} came twice: a disturbance of its last bit made the bus repeat it"
                )
            raise _Failed(f"frame {number + place} is {frame.data.hex(' ')} and not {expected.data.hex(' ')}")
    if len(heard) != len(sent):
        raise _Failed(f"{amount(len(heard), 'frame')} came instead of {len(sent)}, up to number {number + len(heard)}")
