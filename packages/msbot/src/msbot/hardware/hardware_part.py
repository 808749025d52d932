"""A part with real hardware: its driver reads and switches, its model applies the settings, `Part` joins the robot.

Theory of operation. While the part is active, a timer asks for a sample, in the thread of the bus, whenever one is due;
the result is fed into the model and published. Only values that were just read are published. What the model computes
for outputs is handed to the driver whenever it changes, always the newest value only.

A driver that fails is closed. When it has failed often enough, the part leaves its robot, says why, and tries to open
the driver again; it rejoins once a value has been read. So a part is in its robot only while its hardware answers.

On STOP, or when nobody is in command, outputs take their safe values at once and without a ramp; the part confirms to
the master only what was really switched.
"""

from __future__ import annotations

import asyncio
import concurrent.futures
import contextlib
import logging
import traceback
from collections import deque
from collections.abc import Callable, Sequence
from pathlib import Path
from random import Random

from msbot.config import PartType, Scalar
from msbot.hardware.bus_worker import BusWorker
from msbot.hardware.driver import Driver, Values
from msbot.hardware.hardware_fault import HardwareFault
from msbot.part import ExpectedRobot, JoinState, Part
from msbot.part.beginner_hints import part_is_run
from msbot.part.join.pnp_messages import UID_OCTETS, Nature
from msbot.sim import ModelPart
from msbot_agent.link import Link
from msbot_agent.text.similar_names import instead_of
from msbot_xrce.errors import MsbotError

# Tells the robot why a part is not there: hardware that does not answer when the program starts.
#
# Another part with the same name and UID asks for the place, says only what is wrong, and leaves. It never becomes
# active. Where there is no robot yet, it waits for one.


AGAIN_S = 600.0
"""It is told again after this time: to a master that has started since."""
LEAVE_S = 1.0
"""Longest wait for the one that tells to say goodbye."""


class Absence:
    """What the robot knows of it."""

    def __init__(self) -> None:
        self._messenger: Part | None = None
        self._task: asyncio.Task[None] | None = None
        self._told_at: float | None = None

    def tell(self, part: Part, fault: str, connect: Callable[[], Link], now: float) -> None:
        """Have the robot told, unless it was told lately or is just being told.

        Raises:
            MsbotError: the last attempt ended with it, as running the part would have.
        """
        if self._task is not None and self._task.done():
            task, self._task = self._task, None
            task.result()
            if self._messenger is not None and self._messenger.trouble_heard:
                self.is_told(now)
        if self._task is None and (self._told_at is None or now - self._told_at >= AGAIN_S):
            made = Part(part.part_number, uid=part.uid, local_name=part.local_name, robot=part.robot, describes=False)
            made.key, made.nature = part.key, part.nature
            self._messenger = made
            self._task = asyncio.create_task(made.run_async(connect(), absent=fault))

    def is_told(self, now: float) -> None:
        """The robot knows."""
        self._told_at = now

    def is_over(self) -> None:
        """The part is there."""
        self._told_at = None

    async def end(self) -> None:
        """Tell no more."""
        task, self._task = self._task, None
        if task is None or self._messenger is None:
            return
        self._messenger.end()
        await asyncio.wait([task], timeout=LEAVE_S)
        task.cancel()
        await asyncio.wait([task])


MOST_FAULTS = 3
"""This many samples in a row may fail: noise on a wire does not mean that the chip is missing."""
STUCK_S = 3.0
"""A bus that takes longer than this for one job is stuck."""
RETRY_S = 1.0
"""Time between two attempts to open a driver."""
SAFE_S = 0.25
"""Longest wait for a bus to take a safe value. Only here does the loop wait: STOP must not be confirmed any earlier."""
ALIVE_S = 1.0
"""Period in which even a part that speaks only on a change is read."""
MOST_EVENTS = 32
"""Most changes noticed by the driver that wait for the loop; beyond that the oldest is dropped and counted."""
MOST_UNKNOWN = 10
"""Most names of readings that a robot is told of because the model does not have them."""

_log = logging.getLogger("msbot.part")


class ModelValues(dict[str, Scalar]):
    """What the model's sources are now; to ask for a name that is not among them is a fault in words.

    Args:
        values: all sources.
        hints: the names that a driver most likely means.
    """

    def __init__(self, values: Values, hints: Sequence[str]) -> None:
        super().__init__(values)
        self._hints = hints

    def __missing__(self, name: str) -> Scalar:
        words = f"the driver needs the value {name!r}, but the part type has no such source"
        raise HardwareFault(f"{words}; {instead_of(name, self._hints)}")


class HardwarePart(ModelPart):
    """A part with a driver; run it with `await part.run(connect)`."""

    def __init__(
        self,
        part_type: PartType,
        make_driver: Callable[[Callable[[Values], None]], Driver],
        bus: BusWorker,
        *,
        number: str | None = None,
        uid: bytes | None = None,
        local_name: str | None = None,
        random: Random | None = None,
        robot: str | ExpectedRobot = "*",
    ) -> None:
        """Make the part; no hardware is touched before it runs.

        Args:
            part_type: its type.
            make_driver: makes the driver; its argument is the function to call with changes that the driver notices.
            bus: the thread of its bus.
            number: the part number that it shows, perhaps with a version; that of its type if absent.
            uid: 8 octets; drawn when the part runs if absent.
            local_name: what this part is called.
            random: the source of whatever `Part` draws.
            robot: the robot it is made for.
        """
        super().__init__(
            part_type,
            number or part_type.number,
            uid=uid,
            local_name=local_name,
            random=random or Random(),
            robot=robot,
            ideal=True,
        )
        self.part.nature = Nature.REAL
        self.fault = ""
        """Why the hardware does not work, as one sentence; "" = it does."""
        self.faults = 0
        """Number of samples and orders that failed."""
        self.lost_events = 0
        """Changes that came faster than they could be processed."""
        self._driver = make_driver(self._noticed)
        self._unsaid = self._driver.unknown_ports
        self._bus = bus
        self._loop: asyncio.AbstractEventLoop | None = None
        self._open = False
        self._touched = False
        """An attempt was made to open the driver, so it must be closed."""
        self._ended: asyncio.Event | None = None
        self._told_open: Callable[[], None] = lambda: None
        self._told_closed: Callable[[], None] = lambda: None
        self._failed_in_a_row = 0
        self._sampling: asyncio.Future[Values | None] | None = None
        self._asked_at = 0.0
        self._next_at = 0.0
        self._driving: asyncio.Future[None] | None = None
        self._given: object = None
        self._events: deque[Values] = deque(maxlen=MOST_EVENTS)
        self._said_fault = ""
        self._said_mistake = ""
        """The latest mistake of the driver's program whose traceback was logged."""
        self._said_unknown: set[str] = set()
        """Names of readings that the model does not have, and of which the robot was told."""
        self._absence = Absence()
        self._is_leaving = False
        self.part.every(self._tick_s() if not self._driver.drives else 0.02)(self._tick)
        self.part.on_join(self._joined)

    async def run(self, connect: Callable[[], Link]) -> None:
        """Run until `end`: open the hardware, act as a part, and start over when the hardware was gone.

        Args:
            connect: makes a link to the master each time the part joins.
        """
        part_is_run(self.part)
        self._loop = asyncio.get_running_loop()
        self._ended = asyncio.Event()
        try:
            await self._loop.run_in_executor(self._bus, self._driver.load_libraries)
            while not self._ended.is_set():
                if await self._opened():
                    await self._absence.end()
                    await self.part.run_async(connect())
                    if self.part.trouble_heard:
                        self._absence.is_told(self._time())
                    await self._close()
                else:
                    self._tell_absence(connect)
        finally:
            await self._absence.end()
            await self._close()

    def end(self) -> None:
        """End `run` cleanly."""
        if self._ended is not None:
            self._ended.set()
        self.part.end()

    def on_open(self, opens: Callable[[], None], closed: Callable[[], None]) -> None:
        """Call the first before outputs can be on, and the second when all are off."""
        self._told_open, self._told_closed = opens, closed

    # Opening and failing.

    async def _opened(self) -> bool:
        """Try to open the hardware and to read it once; otherwise wait a while."""
        assert self._ended is not None
        try:
            self._touched = True
            self._told_open()
            await self._in_bus(self._driver.open)
            self._open = True
            if self._driver.samples:
                measured = await self._in_bus(lambda: self._driver.sample(self._snapshot()))
                self._world.feed(measured or {}, self._time())
            if self._driver.drives:
                self._driver.outputs_for(self._snapshot())  # a mistake in it shows before the part joins
        except HardwareFault as fault:
            self._note(str(fault))
            await self._close()
        except MsbotError:
            raise
        except Exception as error:
            self._note(str(self._in_words(error)))
            await self._close()
        else:
            if self.fault:
                _log.warning("%s: its hardware answers again", self.part.local_name)
            self.fault = self._said_fault = ""
            self._failed_in_a_row = 0
            self._given = None
            return True
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(RETRY_S):
                await self._ended.wait()
        return False

    async def _close(self) -> None:
        if not self._touched:
            return
        self._open = self._touched = False
        self._is_leaving = False
        self._sampling = self._driving = None
        with contextlib.suppress(HardwareFault):  # closed because it does not answer
            await self._in_bus(self._driver.close)
            self._told_closed()

    async def _in_bus(self, job: Callable[[], Values | None]) -> Values | None:
        assert self._loop is not None
        try:
            async with asyncio.timeout(STUCK_S):
                return await self._loop.run_in_executor(self._bus, job)
        except TimeoutError:
            raise self._stuck() from None

    def _stuck(self) -> HardwareFault:
        return HardwareFault(
            f"{self._bus.name} has not answered for {STUCK_S:g} s: something holds it; check the wires of its parts"
        )

    def _note(self, fault: str) -> None:
        self.faults += 1
        self.fault = fault
        if fault != self._said_fault:
            self._said_fault = fault
            _log.warning("%s: %s", self.part.local_name, fault)

    def _in_words(self, error: BaseException) -> HardwareFault:
        """A mistake in a driver's program as a fault; where it is new, the log has its traceback."""
        if isinstance(error, HardwareFault):
            return error
        place = traceback.extract_tb(error.__traceback__)[-1]
        words = (
            f"the driver failed in line {place.lineno} of {Path(place.filename).name}: {type(error).__name__}: {error}"
        )
        if words != self._said_mistake:
            self._said_mistake = words
            _log.error("%s: %s", self.part.local_name, words, exc_info=error)
        return HardwareFault(words)

    def _tell_absence(self, connect: Callable[[], Link]) -> None:
        """Have the robot told why this part is not there, unless it knows."""
        part = self.part
        if part.uid is None:
            part.uid = Random().randbytes(UID_OCTETS)
        self._absence.tell(part, self.fault, connect, self._time())

    def _failed(self, fault: HardwareFault, *, at_once: bool = False) -> None:
        """A sample or an order has failed; after several the part leaves its robot."""
        self.faults += 1
        self._failed_in_a_row += 1
        if self._failed_in_a_row < MOST_FAULTS and not at_once:
            _log.debug("%s: %s", self.part.local_name, fault)
            return
        self._note(str(fault))
        if not self._is_leaving:
            self._is_leaving = True
            self.part.trouble(str(fault))
            self.part.end()

    # Reading.

    def _joined(self) -> None:
        self._absence.is_over()
        self._said_unknown.clear()
        self._next_at = self._time()

    def _tick(self) -> None:
        now = self._time()
        if self._driver.samples:
            if self._sampling is None and now >= self._next_at - 1e-9:
                self._ask(now)
            elif self._sampling is not None and now - self._asked_at > STUCK_S:
                self._sampling = None
                self._failed(self._stuck(), at_once=True)
        else:
            self._say()
        self._take_settings()
        self._world.advance(now)
        self._move()

    def _ask(self, now: float) -> None:
        assert self._loop is not None
        period_s = self._period_s()
        behind = max(0.0, now - self._next_at)
        self._next_at += (behind // period_s + 1) * period_s
        self._asked_at = now
        snapshot = self._snapshot()
        future = self._loop.run_in_executor(self._bus, lambda: self._driver.sample(snapshot))
        self._sampling = future
        future.add_done_callback(self._sampled)

    def _sampled(self, future: asyncio.Future[Values | None]) -> None:
        if future is not self._sampling:
            if not future.cancelled():
                future.exception()  # too late: the bus was already reported as stuck
            return
        self._sampling = None
        if future.cancelled():
            return
        error = future.exception()
        if error is not None:
            self._failed(self._in_words(error))
            return
        self._failed_in_a_row = 0
        measured = future.result()
        if measured is not None and self.part.state is JoinState.ACTIVE:
            self._take(measured)

    def _take(self, measured: Values) -> None:
        for name in self._world.feed(measured, self._time()):
            self._say_unknown(name, measured)
        self._say()
        self._move()

    def _say_unknown(self, name: str, measured: Values) -> None:
        """Tell people once in each robot: what the driver reads goes nowhere.

        It is an error where a control is left that nothing measures: the name is misspelt, and the part publishes what
        its type starts with. Else the type uses less than the driver reads.
        """
        if name in self._said_unknown or len(self._said_unknown) >= MOST_UNKNOWN:
            return
        self._said_unknown.add(name)
        words = f"the driver reads {name!r}, but the part type has no such control or reading"
        is_error = any(control.name not in measured for control in self._simulator.controls)
        self.part.log(f"{words}; {instead_of(name, self._sources())}", level="error" if is_error else "warning")

    def _period_s(self) -> float:
        """The period of reading: as often as the part publishes with its present settings."""
        periods = [ALIVE_S]
        for output in self._simulator.outputs:
            every = self._world.values[output.every] if isinstance(output.every, str) else output.every
            if isinstance(every, int | float) and every > 0:
                periods.append(every)
            if output.on_change and self._driver.poll_s:
                periods.append(self._driver.poll_s)
        shortest = min(periods[1:], default=ALIVE_S)
        return max(0.02, shortest)

    def _snapshot(self) -> ModelValues:
        return ModelValues(self._world.values, self._sources())

    def _sources(self) -> list[str]:
        """What a driver may read and switch, by name."""
        model = self._simulator
        return [*(entry.name for entry in model.controls), *(entry.name for entry in model.readings)]

    def _noticed(self, measured: Values) -> None:
        """From any thread: something has changed."""
        if self._loop is None or self._loop.is_closed():
            return
        if len(self._events) == MOST_EVENTS:
            self.lost_events += 1
        self._events.append(measured)
        with contextlib.suppress(RuntimeError):  # the loop has just ended
            self._loop.call_soon_threadsafe(self._take_events)

    def _take_events(self) -> None:
        while self._events:
            measured = self._events.popleft()
            if self.part.state is JoinState.ACTIVE:
                self._take(measured)
            else:
                self._world.feed(measured, self._time())

    # Switching.

    def _moved(self) -> None:
        self._move()

    def _move(self) -> None:
        """Hand the newest outputs to the driver, if they have changed."""
        if not (self._driver.drives and self._open):
            return
        try:
            wanted = self._driver.outputs_for(self._snapshot())
        except Exception as error:
            self._failed(self._in_words(error))
            return
        if wanted == self._given:
            return
        if not self._driver.blocking:
            try:
                self._driver.drive(wanted)
            except HardwareFault as fault:
                self._failed(fault)
            else:
                self._given = wanted
        elif self._driving is None:
            assert self._loop is not None
            self._given = wanted
            self._driving = future = self._loop.run_in_executor(self._bus, self._driver.drive, wanted)
            future.add_done_callback(self._driven)

    def _driven(self, future: asyncio.Future[None]) -> None:
        if future is not self._driving:
            if not future.cancelled():
                future.exception()  # of a driver that has been closed since
            return
        self._driving = None
        if future.cancelled():
            return
        error = future.exception()
        if error is not None:
            self._given = None
            self._failed(self._in_words(error))
        elif self._open:
            self._move()

    def _be_safe(self) -> None:
        super()._be_safe()
        if not self._is_commanded and self._driver.drives and self._open:
            self._world.jump_to_targets(self._time())
            self._drive_now(self._driver.outputs_for(self._snapshot()))

    def _drive_now(self, wanted: object) -> None:
        """Switch the outputs before returning.

        Raises:
            HardwareFault: they may not have been switched; then STOP is not confirmed, and is tried again.
        """
        if not self._driver.blocking:
            self._driver.drive(wanted)
        else:
            try:
                self._bus.submit(self._driver.drive, wanted).result(SAFE_S)
            except concurrent.futures.TimeoutError:
                raise HardwareFault(f"{self._bus.name} has not taken the safe value within {SAFE_S:g} s") from None
        self._given = wanted
