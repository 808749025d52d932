"""A person's change on its way to the database, and how a thread or an event loop waits for it."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from concurrent.futures import Executor, Future
from typing import Generic, TypeVar, cast

from sqlalchemy import Connection

_T = TypeVar("_T")


class PendingChange(Executor, Generic[_T]):
    """A person's change on its way to the database; made by `Writer.submit`.

    It is an executor so that an event loop with a virtual clock knows that a thread is working for it.
    """

    def __init__(
        self, give_up: Callable[[PendingChange[_T]], _T], change: Callable[[Connection], _T], wait_s: float
    ) -> None:
        self.change = change
        self.wait_s = wait_s
        """How long it waits for another program that is writing."""
        self.done: Future[_T] = Future()
        self.is_given_up = False
        self.is_being_stored = False
        self._give_up = give_up

    def submit(self, _fn: object, /, *_args: object, **_kwargs: object) -> Future[_T]:  # type: ignore[override]
        """The future that the event loop waits for."""
        return self.done

    def wait(self, limit_s: float) -> _T:
        """Wait until it is stored; returns what the change returns.

        Raises:
            RegistryError: it cannot be stored and nothing has changed, or it is unknown whether it was; the text says
                which.
            Exception: what the change raises.
        """
        try:
            return self.done.result(limit_s)
        except TimeoutError:
            return self._give_up(self)

    async def stored(self, limit_s: float) -> _T:
        """The same for an event loop, without blocking it."""
        waiting = asyncio.get_running_loop().run_in_executor(self, self.done.result)
        done, _ = await asyncio.wait({waiting}, timeout=limit_s)
        if done:
            return waiting.result()
        waiting.cancel()
        return self._give_up(self)

    def answer(self, made: _T | None = None, *, error: BaseException | None = None) -> None:
        """Tell who waits what came of it; who has stopped waiting has cancelled it and is told nothing."""
        if not self.done.set_running_or_notify_cancel():
            return
        if error is None:
            self.done.set_result(cast("_T", made))
        else:
            self.done.set_exception(error)
