"""The calls that a part makes and the requests that it serves: `calls` with a clock and the program's functions."""

from __future__ import annotations

import asyncio
import functools
from collections.abc import Callable

from msbot.part.calls import LONGEST_TIMEOUT_S, MOST_SERVED, OpenCalls, ReplyStatus, encode_reply, refusal_words
from msbot.part.client.client import IDENTITY_OCTETS, RELATED_OCTETS
from msbot.part.handler_guard import Guard, check_handler
from msbot.part.join.pnp_messages import BindingDirection, PortBinding
from msbot.part.messages.message import Message
from msbot.part.ports import LARGEST_MESSAGE, Ports
from msbot.part.program import Exchange, ProgramDeclarations, Server
from msbot_xrce.errors import CallError, ConfigError, LocalProtocolError, RemoteProtocolError

LARGEST_REPLY = LARGEST_MESSAGE - IDENTITY_OCTETS
"""Octets of a reply, which goes back with the identity of its request."""


class CallIgnored(Exception):
    """A function that serves leaves a request without a reply, as a part does that hangs: for tests."""


class PartCalls:
    """The calls of one part.

    Args:
        program: what it declares.
        guard: calls its functions.
    """

    def __init__(self, program: ProgramDeclarations, guard: Guard) -> None:
        self._program = program
        self._guard = guard
        self._open = OpenCalls()
        self._unseal: Callable[[int, bytes], bytes | None] = lambda _, octets: octets
        self._is_stopped: Callable[[], bool] = lambda: False
        self._standing: list[tuple[str, Callable[[object], None]]] = []
        """Port of each call that has ended while STOP holds, and how its function goes on."""
        self._alarm: asyncio.TimerHandle | None = None

    def begin(self, unseal: Callable[[int, bytes], bytes | None], is_stopped: Callable[[], bool]) -> None:
        """The part begins to run.

        Args:
            unseal: opens what the agent delivers, None: refused.
            is_stopped: whether STOP holds.
        """
        self._unseal, self._is_stopped = unseal, is_stopped

    def call(
        self,
        ports: Ports,
        port: str,
        request: Message,
        timeout_s: float,
        on_reply: Callable[[Message | None, str], object] | None,
    ) -> Message | None:
        """Send a request, then wait for its reply, or have `on_reply` called with it.

        Raises:
            CallError: there is no reply; the text says why. With `on_reply`: the request could not be sent.
            ConfigError: the call is wrong.
            LocalProtocolError: a function that calls cannot wait here.
        """
        exchange = self._checked(port, request, timeout_s)
        if on_reply is not None:
            check_handler(on_reply, "reply, error")
        elif not self._guard.may_wait():
            raise LocalProtocolError(
                f"part.call({port!r}, ...) waits for the reply, and can do so only in a function below @part.every, "
                "@part.on, @part.serves or @part.on_join; anywhere else, give it on_reply=..."
            )
        if port not in ports:
            raise CallError(
                f"call of {port}: this robot does not use the port: join it in a [[binding]] whose `to` names it; "
                f"{ports.describe}"
            )
        if fault := ports.service_fault(port, exchange.type_name, BindingDirection.CALL):
            raise CallError(f"call of {port}: the port {fault}")
        self._open.check_room(port)
        number = ports.send_request(port, request)
        if number is None:
            raise CallError(f"call of {port}: there is no room on the way to the robot now: call again later")
        if on_reply is None:
            outcome = self._guard.wait(lambda go_on: self._opened(number, port, timeout_s, self._held(port, go_on)))
            if isinstance(outcome, bytes):
                outcome = self._read(port, exchange, outcome)
            if isinstance(outcome, CallError):
                raise outcome
            assert isinstance(outcome, Message)
            return outcome

        def done(outcome: object) -> None:
            assert on_reply is not None
            found: object = outcome
            if isinstance(outcome, bytes):
                found = _stopped(port) if self._is_stopped() else self._read(port, exchange, outcome)
            if isinstance(found, Message):
                self._guard.call(on_reply, found, "")
            else:
                self._guard.call(on_reply, None, str(found))

        self._opened(number, port, timeout_s, done)
        return None

    def replied(self, object_id: int, number: int, payload: bytes) -> None:
        """The agent has delivered a reply to one of the part's requesters."""
        related = number.to_bytes(2, "big") + object_id.to_bytes(2, "big")
        opened = self._unseal(object_id, related + payload)
        if opened is not None:
            self._open.replied(number, opened[RELATED_OCTETS:])
            self._set_alarm()

    def end(self, why: str, port: str | None = None) -> None:
        """End all open calls, or those of one port, for a reason in words."""
        self._open.fail(why, port)
        self._set_alarm()

    @property
    def stand_still(self) -> bool:
        """Whether functions wait for GO whose calls have ended."""
        return bool(self._standing)

    def stop_is_over(self) -> None:
        """GO: the functions whose calls have ended meanwhile go on; what was replied before GO counts no more."""
        standing, self._standing = self._standing, []
        for port, go_on in standing:
            go_on(CallError(f"call of {port}: STOP was said meanwhile: call again"))

    def end_all(self, why: str) -> None:
        """The part ends, and with it every call, for a reason in words."""
        self._is_stopped = lambda: False
        self.end(why)
        standing, self._standing = self._standing, []
        for port, go_on in standing:
            go_on(CallError(f"call of {port}: {why}"))

    def _held(self, port: str, go_on: Callable[[object], None]) -> Callable[[object], None]:
        """As `go_on`, but no reply moves anything while STOP holds: a function that waits since before stands still."""
        is_from_before = not self._is_stopped()

        def ended(outcome: object) -> None:
            if not self._is_stopped():
                go_on(outcome)
            elif is_from_before:
                self._standing.append((port, go_on))
            else:
                go_on(_stopped(port) if isinstance(outcome, bytes) else outcome)

        return ended

    def _checked(self, port: str, request: Message, timeout_s: float) -> Exchange:
        exchange = self._program.calls.get(port) if isinstance(port, str) else None
        if exchange is None:
            raise ConfigError(
                f"part.call({port!r}, ...): say at the top of the program what goes and what comes: "
                f"part.calls({port!r}, Request, Reply)"
            )
        if type(request) is not exchange.request:
            given = request.__name__ if isinstance(request, type) else type(request).__name__
            raise ConfigError(f"port {port!r} sends {exchange.request.__name__}(...), not {given}")
        if not isinstance(timeout_s, int | float) or not 0 < timeout_s <= LONGEST_TIMEOUT_S:
            raise ConfigError(
                f"part.call({port!r}, ..., timeout={timeout_s!r}): the timeout is a number of seconds over 0 and up to "
                f"{LONGEST_TIMEOUT_S:g}"
            )
        return exchange

    def _opened(self, number: int, port: str, timeout_s: float, done: Callable[[object], None]) -> None:
        self._open.open(number, port, timeout_s, asyncio.get_running_loop().time(), done)
        self._set_alarm()

    def _read(self, port: str, exchange: Exchange, octets: bytes) -> Message | CallError:
        try:
            return exchange.reply.decode(octets)
        except RemoteProtocolError as error:
            return CallError(f"call of {port}: the reply cannot be read as {exchange.reply.__name__}: {error}")

    def _set_alarm(self) -> None:
        at = self._open.timer()
        if self._alarm is not None:
            self._alarm.cancel()
        self._alarm = None if at is None else asyncio.get_running_loop().call_at(at, self._ring)

    def _ring(self) -> None:
        self._open.handle_timer(asyncio.get_running_loop().time())
        self._set_alarm()


def _stopped(port: str) -> CallError:
    """What a caller gets in place of a reply that comes while STOP holds."""
    return CallError(f"call of {port}: {ReplyStatus.STOPPED.describe}")


class PartServices:
    """The requests that one part serves.

    Args:
        program: its functions.
        guard: calls them.
    """

    def __init__(self, program: ProgramDeclarations, guard: Guard) -> None:
        self._program = program
        self._guard = guard
        self._serving = 0

    def serve(self, binding: PortBinding, request: bytes, *, stopped: bool, reply: Callable[[bytes], None]) -> bool:
        """Have a request served; `reply` is called once with the octets of the reply.

        False: it was refused before any function of the program saw it.
        """
        server = self._program.servers.get(binding.port)
        if server is None or server.exchange.type_name != binding.topic_type:
            reply(encode_reply(ReplyStatus.NOT_SERVED))
        elif stopped:
            reply(encode_reply(ReplyStatus.STOPPED))
        elif self._serving >= MOST_SERVED:
            reply(encode_reply(ReplyStatus.BUSY))
        else:
            try:
                message = server.exchange.request.decode(request)
            except RemoteProtocolError as error:
                reply(encode_reply(ReplyStatus.UNREADABLE, str(error)))
                return False
            self._serving += 1
            self._guard.call(self._server(binding.port, server, reply), message)
            return True
        return False

    def _server(self, port: str, server: Server, reply: Callable[[bytes], None]) -> Callable[[Message], None]:
        @functools.wraps(server.function)
        def served(request: Message) -> None:
            octets: bytes | None = encode_reply(ReplyStatus.FAILED)
            try:
                answer = server.function(request)
                if type(answer) is server.exchange.reply:
                    encoded = encode_reply(ReplyStatus.DONE, answer.encode())
                    if len(encoded) > LARGEST_REPLY:
                        raise LocalProtocolError(
                            f"the reply has {len(encoded):,} bytes, and may have {LARGEST_REPLY:,}: send less"
                        )
                    octets = encoded
                else:
                    wanted = server.exchange.reply.__name__
                    octets = encode_reply(ReplyStatus.FAILED, f"it returned {answer!r:.60}, not a {wanted}")
                    name = getattr(server.function, "__name__", "a function")
                    self._guard.report(
                        name, f"returned {answer!r:.60}: below @part.serves({port!r}, ...) return {wanted}(...)"
                    )
            except CallIgnored:
                octets = None
            except CallError as error:
                octets = encode_reply(ReplyStatus.REFUSED, refusal_words(error))
            except Exception as error:
                octets = encode_reply(ReplyStatus.FAILED, f"{type(error).__name__}: {error}")
                raise
            finally:
                self._serving -= 1
                if octets is not None:
                    reply(octets)

        return served
