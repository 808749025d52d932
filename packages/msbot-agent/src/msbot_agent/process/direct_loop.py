"""An event loop that calls the readers of sockets as soon as the kernel has named them (Linux only).

asyncio makes a turn of every event: it puts the reader's handle into its queue, looks at its timers, runs the queue and
asks the kernel again. For an agent that answers one datagram at a time such a turn costs as much as the answer. Here
the selector calls the readers and asks again by itself, for as long as nothing else is to be done: nothing was put into
the loop's queue, no timer is due, and the kernel named nothing else. It needs no more of asyncio than what is public.

Between two questions it pauses where that pays (`Gathering`). A reader that takes several datagrams at a time tells how
many to `gathering_of` its loop, and ends when a pause is due.
"""

from __future__ import annotations

import asyncio
import os
import select
import selectors
import sys
import time
from collections.abc import Callable
from contextvars import Context, copy_context
from typing import Any, Protocol, TypeVarTuple

from msbot_agent.process.gathering import LONGEST_S, Gathering

_Ts = TypeVarTuple("_Ts")


class _HasNumber(Protocol):
    def fileno(self) -> int: ...


Descriptor = int | _HasNumber

MOST_NAMED = 64
"""Descriptors that one question to the kernel names at most; the rest are named by the next one."""

if sys.platform == "linux":
    _READ, _WRITE = select.EPOLLIN, select.EPOLLOUT

    def _number(descriptor: Descriptor) -> int:
        return descriptor if isinstance(descriptor, int) else descriptor.fileno()

    class DirectSelector(selectors.EpollSelector):
        """Names what a loop has to see to, and calls what needs no loop."""

        def __init__(self, gathering: Gathering) -> None:
            super().__init__()
            self.gathering = gathering
            # The standard class does not show its own; a second name of the same one is what it gives.
            self._kernel = select.epoll.fromfd(os.dup(self.fileno()))
            self._keys: dict[int, selectors.SelectorKey] = {}
            self.readers: dict[int, Callable[[], object]] = {}
            """What to call when a descriptor has something to read, and nothing else has happened to it; forgotten
            whenever somebody registers it for something else."""
            self.must_return = False
            """Whether there is something for the loop to do since it asked last."""

        def register(
            self,
            fileobj: Descriptor,
            events: int,
            data: Any = None,  # noqa: ANN401 - as it is there
        ) -> selectors.SelectorKey:
            """As in every selector."""
            return self._noted(super().register(fileobj, events, data))

        def modify(
            self,
            fileobj: Descriptor,
            events: int,
            data: Any = None,  # noqa: ANN401 - as it is there
        ) -> selectors.SelectorKey:
            """As in every selector."""
            return self._noted(super().modify(fileobj, events, data))

        def _noted(self, key: selectors.SelectorKey) -> selectors.SelectorKey:
            self._keys[key.fd] = key
            self.readers.pop(key.fd, None)
            return key

        def unregister(self, fileobj: Descriptor) -> selectors.SelectorKey:
            """As in every selector."""
            key = super().unregister(fileobj)
            self._keys.pop(key.fd, None)
            self.readers.pop(key.fd, None)
            return key

        def close(self) -> None:
            """As in every selector."""
            self._kernel.close()
            self._keys.clear()
            self.readers.clear()
            super().close()

        def select(self, timeout: float | None = None) -> list[tuple[selectors.SelectorKey, int]]:
            """What is ready, but for what was called here; after `timeout` seconds at the latest (None: no limit)."""
            self.must_return = False
            ask, readers, gathering, clock = self._kernel.poll, self.readers, self.gathering, time.monotonic
            if timeout is None:
                left, until = -1.0, None
            else:
                left = max(timeout, 0.0)
                until = clock() + left if left else 0.0
            while True:
                if gathering.delay_s and left:
                    time.sleep(gathering.delay_s if left < 0.0 else min(gathering.delay_s, left))
                found = ask(left, MOST_NAMED)
                if len(found) == 1:  # nearly always
                    descriptor, happened = found[0]
                    reader = readers.get(descriptor) if happened == _READ else None
                    if reader is None:
                        return self._named(found)
                    reader()
                elif not found:
                    return []
                elif self._call(found):
                    return self._named(found)
                if self.must_return:
                    return []
                if until is not None:
                    left = until - clock()
                    if left <= 0.0:
                        return []

        def _call(self, found: list[tuple[int, int]]) -> bool:
            """Call the readers among these and take them out of the list; whether anything is left."""
            readers = self.readers
            direct = [
                (descriptor, reader)
                for descriptor, happened in found
                if happened == _READ and (reader := readers.get(descriptor)) is not None
            ]
            called = {descriptor for descriptor, _ in direct}
            found[:] = [event for event in found if event[0] not in called]
            for descriptor, reader in direct:
                if readers.get(descriptor) is reader:  # none before it has ended its watch
                    reader()
            return bool(found)

        def _named(self, found: list[tuple[int, int]]) -> list[tuple[selectors.SelectorKey, int]]:
            self.gathering.turn(time.monotonic(), len(found))
            ready = []
            for descriptor, happened in found:
                key = self._keys.get(descriptor)
                if key is not None:
                    events = (happened & ~_READ and selectors.EVENT_WRITE) | (
                        happened & ~_WRITE and selectors.EVENT_READ
                    )
                    ready.append((key, events & key.events))
            return ready

    class DirectLoop(asyncio.SelectorEventLoop):
        """See the module's docstring."""

        def __init__(self, longest_pause_s: float = LONGEST_S) -> None:
            """`longest_pause_s`: see `Gathering`."""
            self._direct = DirectSelector(Gathering(longest_pause_s))
            super().__init__(self._direct)

        time = staticmethod(time.monotonic)
        """The clock, without a function of Python around it: it is asked several times for each datagram."""

        @property
        def gathering(self) -> Gathering:
            """What decides on its pauses."""
            return self._direct.gathering

        def add_reader(self, fd: Descriptor, callback: Callable[[*_Ts], Any], *args: *_Ts) -> None:
            """As in every loop; the callback may be called before what waits in the loop's queue.

            If it returns True, it has told `gathering_of` the loop what it took.
            """
            super().add_reader(fd, callback, *args)
            if self.get_debug():  # then asyncio measures how long each one takes
                return
            run, turn, clock = copy_context().run, self._direct.gathering.turn, time.monotonic

            def read() -> None:
                try:
                    if run(callback, *args) is not True:
                        turn(clock(), 1)
                except (SystemExit, KeyboardInterrupt):
                    raise
                except BaseException as error:  # as asyncio does
                    self.call_exception_handler({"message": f"Exception in callback {callback}", "exception": error})

            self._direct.readers[_number(fd)] = read

        def remove_reader(self, fd: Descriptor) -> bool:
            """As in every loop."""
            self._direct.readers.pop(_number(fd), None)
            return super().remove_reader(fd)

        def add_writer(self, fd: Descriptor, callback: Callable[[*_Ts], Any], *args: *_Ts) -> None:
            """As in every loop."""
            reader = self._direct.readers.get(_number(fd))
            super().add_writer(fd, callback, *args)
            self._keep(fd, reader)

        def remove_writer(self, fd: Descriptor) -> bool:
            """As in every loop."""
            reader = self._direct.readers.get(_number(fd))
            had_one = super().remove_writer(fd)
            self._keep(fd, reader)
            return had_one

        def _keep(self, fd: Descriptor, reader: Callable[[], object] | None) -> None:
            if reader is not None:
                self._direct.readers[_number(fd)] = reader

        def call_soon(
            self, callback: Callable[[*_Ts], object], *args: *_Ts, context: Context | None = None
        ) -> asyncio.Handle:
            """As in every loop."""
            self._direct.must_return = True
            return super().call_soon(callback, *args, context=context)

        def call_at(
            self, when: float, callback: Callable[[*_Ts], object], *args: *_Ts, context: Context | None = None
        ) -> asyncio.TimerHandle:
            """As in every loop."""
            self._direct.must_return = True
            return super().call_at(when, callback, *args, context=context)

        def stop(self) -> None:
            """As in every loop."""
            self._direct.must_return = True
            super().stop()

    def gathering_of(loop: asyncio.AbstractEventLoop) -> Gathering | None:
        """What decides on the pauses of that loop; None: it makes none."""
        return loop.gathering if isinstance(loop, DirectLoop) else None

else:

    class DirectLoop(asyncio.SelectorEventLoop):
        """Elsewhere asyncio's own; it makes no pauses."""

        def __init__(self, longest_pause_s: float = LONGEST_S) -> None:  # noqa: ARG002 - one signature for all systems
            super().__init__()

    def gathering_of(loop: asyncio.AbstractEventLoop) -> Gathering | None:  # noqa: ARG001 - as above
        """What decides on the pauses of that loop; None: it makes none."""
        return None
