"""The simulated bus as an interface of python-can: `can.Bus(interface="msbot", channel="classroom")`.

Theory of operation. A bus object is one controller, connected with the process that serves the bus (`server.py`); if no
process does, this one serves it, in a thread, as long as it has a bus object open. Another thread reads the connection,
keeps a bounded number of frames for `recv`, and wakes threads that wait in `send`. As with a real adapter, `send` hands
a frame over and does not wait until it is on the bus. A few frames fit into the controller; if no node acknowledges
them, the next `send` waits, and fails when its timeout expires.
"""

from __future__ import annotations

import logging
import socket
import threading
import time
from collections import deque
from collections.abc import Callable, Sequence
from typing import Final
from weakref import WeakSet

from can.broadcastmanager import CyclicSendTaskABC, ThreadBasedCyclicSendTask
from can.typechecking import AutoDetectedConfig, CanFilters

import can
from msbot_agent.link.can.adapters.python_can import frame_of, message_of
from msbot_agent.link.can.controller import BusState
from msbot_agent.link.can.protocol.frames import Frame, check_frame
from msbot_agent.link.can.sim.bus_names import DEFAULT_NAME, existing_bus, list_buses, rates_words
from msbot_agent.link.can.sim.model.sim_bus import MAILBOXES
from msbot_agent.link.can.sim.model.sim_bus_messages import (
    BusFrame,
    FrameRejected,
    FrameSent,
    FramesLost,
    Hello,
    Message,
    Refused,
    Restart,
    Splitter,
    StateTold,
    Welcome,
    encode,
)
from msbot_agent.link.can.sim.sim_bus_client import CONNECT_S, LOST_WORDS, SimBusRequest
from msbot_agent.link.can.sim.sim_bus_thread import hold, release
from msbot_xrce.errors import LinkDown, LocalProtocolError, MsbotError, RemoteProtocolError

UNREAD_FRAMES: Final = 65536
"""Frames kept for `recv`; beyond, new ones are lost, and the log says so once."""
LINGER_S: Final = 1.0
"""Longest time that leaving the bus waits for frames that were not acknowledged yet."""
OVERFLOW_WORDS: Final = "simulated bus %s: nobody calls recv(), frames are lost (said once)"

_STATES: Final = {
    BusState.ACTIVE: can.BusState.ACTIVE,
    BusState.PASSIVE: can.BusState.PASSIVE,
    BusState.OFF: can.BusState.ERROR,
}
_log = logging.getLogger(__name__)


class MsbotBus(can.BusABC):
    """One controller on a simulated bus. Its methods may be called from any thread."""

    def __init__(
        self,
        channel: str | None = None,
        can_filters: CanFilters | None = None,
        *,
        bitrate: int | None = None,
        data_bitrate: int | None = None,
        fd: bool = False,
        receive_own_messages: bool = False,
        listen_only: bool = False,
        node: str = "python-can",
        **kwargs: object,
    ) -> None:
        """Join the bus, or serve it if no process does.

        Args:
            channel: name of the bus; `classroom` if absent.
            can_filters: see `can.BusABC.set_filters`.
            bitrate: nominal bit rate in bit/s that the bus must have; None = any (500,000 if it is served here).
            data_bitrate: the same for the data phase of CAN FD; None = any (2,000,000).
            fd: it must be a CAN FD bus.
            receive_own_messages: `recv` also returns own frames, once they were acknowledged.
            listen_only: do not send, and do not acknowledge.
            node: what the controller is called, for people who watch the bus.
            kwargs: what python-can hands to every interface.

        Raises:
            can.CanInitializationError: the bus cannot be joined; the text says why.
        """
        self._name = channel or DEFAULT_NAME
        self._own = receive_own_messages
        self._listen_only = listen_only
        self._news = threading.Condition()
        self._messages: deque[can.Message] = deque()
        self._outstanding: dict[int, can.Message] = {}
        self._tag = 0
        self._bus_state = BusState.ACTIVE
        self._ended = ""
        self._periodic: WeakSet[CyclicSendTaskABC] = WeakSet()
        self._told_overflow = False
        self._served_here = False
        self._socket: socket.socket | None = None
        self._splitter = Splitter()
        # The offset from the bus' monotonic time to the time since 1970 that messages carry.
        self._epoch_s = time.time() - time.monotonic()
        data_rate = int(data_bitrate) if data_bitrate is not None and fd else None
        wish = SimBusRequest(self._name, None if bitrate is None else int(bitrate), data_rate, fd or None)
        try:
            welcome = self._join(wish, Hello(b"", node, listen_only=listen_only))
        except MsbotError as error:
            self._let_go()
            raise can.CanInitializationError(str(error)) from error
        words = rates_words(welcome.bitrate, welcome.data_bitrate, fd=welcome.fd)
        self.channel_info = f"simulated bus {self._name} ({words})"
        self._can_protocol = can.CanProtocol.CAN_FD if welcome.fd else can.CanProtocol.CAN_20
        self._reader = threading.Thread(target=self._read, name=f"reader of {self.channel_info}", daemon=True)
        self._reader.start()
        super().__init__(self._name, can_filters, **kwargs)

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        """Hand a frame to the controller, which sends it repeatedly until a node acknowledges it.

        Args:
            msg: the frame.
            timeout: seconds to wait while the controller is full; None = without limit.

        Raises:
            can.CanTimeoutError: the controller was full all the time; the frame is not sent.
            can.CanOperationError: the bus has ended, this object was shut down or is listen-only, the controller is
                bus-off, or it cannot send such a frame.
        """
        frame = frame_of(msg)
        self._check(frame)
        with self._news:
            if self._listen_only:
                raise can.CanOperationError(f"{self.channel_info} was opened to listen only")
            self._news.wait_for(lambda: self._is_settled() or len(self._outstanding) < MAILBOXES, timeout)
            if self._ended:
                if self._is_stopped_task():
                    return  # it was about to send when it was stopped: nothing is missing
                raise can.CanOperationError(self._ended)
            if self._bus_state is BusState.OFF:
                raise can.CanOperationError(
                    f"{self.channel_info}: the controller is bus-off; `bus.state = can.BusState.ACTIVE` brings it back"
                )
            if len(self._outstanding) >= MAILBOXES:
                raise can.CanTimeoutError(
                    f"{self.channel_info}: the controller holds {MAILBOXES} frames that nobody acknowledges: "
                    "is another node on the bus?"
                )
            self._tag = self._tag + 1 & 0xFFFFFFFF
            self._outstanding[self._tag] = msg
            try:
                octets = encode(BusFrame(frame, self._tag))
                assert self._socket is not None
                self._socket.sendall(octets)
            except OSError as error:
                raise can.CanOperationError(f"the simulated bus {self._name!r} has ended ({error})") from error

    def shutdown(self) -> None:
        """Leave the bus; a bus that this process serves ends with its last user here.

        Frames that the controller still holds have up to `LINGER_S` seconds to be acknowledged.
        """
        super().shutdown()
        with self._news:
            self._news.wait_for(lambda: self._is_settled() or not self._outstanding, LINGER_S)
        self._let_go()

    @property
    def state(self) -> can.BusState:
        """ACTIVE, PASSIVE (error-passive) or ERROR (bus-off)."""
        return _STATES[self._bus_state]

    @state.setter
    def state(self, new_state: can.BusState) -> None:
        """Setting ACTIVE ends bus-off; no other value is allowed.

        Raises:
            ValueError: another value.
        """
        if new_state is not can.BusState.ACTIVE:
            raise ValueError(f"a controller cannot be told to be {new_state.name}; open the bus with listen_only=True")
        with self._news:
            if self._bus_state is BusState.OFF and self._socket is not None:
                self._socket.sendall(encode(Restart()))

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        with self._news:
            self._news.wait_for(lambda: self._messages or self._ended, timeout)
            if self._messages:
                return self._messages.popleft(), False
            if self._ended:
                raise can.CanOperationError(self._ended)
            return None, False

    def _send_periodic_internal(
        self,
        msgs: Sequence[can.Message] | can.Message,
        period: float,
        duration: float | None = None,
        autostart: bool = True,
        modifier_callback: Callable[[can.Message], None] | None = None,
    ) -> CyclicSendTaskABC:
        # It begins when it is known here: it may be stopped before it has sent anything.
        task = super()._send_periodic_internal(msgs, period, duration, False, modifier_callback)
        self._periodic.add(task)
        if autostart and isinstance(task, ThreadBasedCyclicSendTask):
            task.start()
        return task

    def _is_stopped_task(self) -> bool:
        """Whether this thread is a periodic task's that was stopped: python-can does not wait for its end."""
        thread = threading.current_thread()
        return any(
            isinstance(task, ThreadBasedCyclicSendTask) and task.thread is thread and task.stopped
            for task in self._periodic
        )

    @staticmethod
    def _detect_available_configs() -> list[AutoDetectedConfig]:
        return [AutoDetectedConfig(interface="msbot", channel=bus.name) for bus in list_buses()]

    def _join(self, wish: SimBusRequest, hello: Hello) -> Welcome:
        self._served_here = hold(wish)
        bus = existing_bus(wish.name)
        wish.check(bus)
        try:
            connection = self._socket = socket.create_connection(("127.0.0.1", bus.port), CONNECT_S)
            connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            connection.sendall(encode(Hello(bytes.fromhex(bus.key), hello.name, listen_only=hello.listen_only)))
            messages: list[Message] = []
            while not messages:
                messages = self._splitter.receive(self._receive(connection))
            connection.settimeout(None)
        except (OSError, RemoteProtocolError) as error:
            raise LinkDown(f"cannot join the simulated bus {bus.name!r} of process {bus.pid}: {error}") from error
        first, *others = messages
        if isinstance(first, Refused):
            raise LinkDown(f"the simulated bus {bus.name!r} refuses this program: {first.words}")
        if not isinstance(first, Welcome):
            raise LinkDown(f"process {bus.pid} does not serve the simulated bus {bus.name!r} as it should")
        for message in others:
            self._handle(message)
        return first

    @staticmethod
    def _receive(connection: socket.socket) -> bytes:
        octets = connection.recv(65536)
        if not octets:
            raise ConnectionResetError("it closed the connection")
        return octets

    def _read(self) -> None:
        connection = self._socket
        words = f"the simulated bus {self._name!r} has ended"
        try:
            while connection is not None:
                messages = self._splitter.receive(self._receive(connection))
                with self._news:
                    for message in messages:
                        self._handle(message)
                    self._news.notify_all()
        except RemoteProtocolError as error:
            words = f"the program that serves the simulated bus {self._name!r} talks nonsense: {error}"
        except OSError:
            pass  # the connection has ended, on either side: reported below
        with self._news:
            self._ended = self._ended or words
            self._news.notify_all()

    def _handle(self, message: Message) -> None:
        match message:
            case BusFrame():
                self._keep(message_of(message.frame), message.at, is_rx=True)
            case FrameSent():
                own = self._outstanding.pop(message.tag, None)
                if own is not None and self._own:
                    self._keep(message_of(frame_of(own)), message.at, is_rx=False)
            case FrameRejected():
                self._outstanding.pop(message.tag, None)
                _log.warning("%s: a frame was not sent: %s", self.channel_info, message.words)
            case StateTold():
                self._bus_state = message.state
                if message.state is BusState.OFF:
                    self._outstanding.clear()
                level = logging.INFO if message.state is BusState.ACTIVE else logging.WARNING
                _log.log(level, "%s: %s: %s", self.channel_info, message.state.value, message.words)
            case FramesLost():
                _log.warning("%s: %s", self.channel_info, LOST_WORDS)
            case _:
                raise RemoteProtocolError("message that a server does not send, or not then")

    def _keep(self, message: can.Message, at: float, *, is_rx: bool) -> None:
        if len(self._messages) >= UNREAD_FRAMES:
            if not self._told_overflow:
                self._told_overflow = True
                _log.warning(OVERFLOW_WORDS, self._name)
            return
        message.timestamp = at + self._epoch_s
        message.channel = self._name
        message.is_rx = is_rx
        self._messages.append(message)

    def _check(self, frame: Frame) -> None:
        try:
            check_frame(frame)
        except LocalProtocolError as error:
            raise can.CanOperationError(str(error)) from error
        if frame.fd and self._can_protocol is not can.CanProtocol.CAN_FD:
            raise can.CanOperationError(f"{self.channel_info} carries no CAN FD frames")

    def _is_settled(self) -> bool:
        """Whether there is no point in waiting for room."""
        return bool(self._ended) or self._bus_state is BusState.OFF

    def _let_go(self) -> None:
        with self._news:  # a thread that sends has handed over its frame, or is told
            connection, self._socket = self._socket, None
            self._ended = self._ended or f"this object of the simulated bus {self._name!r} was shut down"
            self._news.notify_all()
        if connection is not None:
            try:
                connection.shutdown(socket.SHUT_RDWR)  # wakes the reader
            except OSError:
                _log.debug("simulated bus %s: the other side was quicker", self._name)
            connection.close()
        reader = getattr(self, "_reader", None)
        if reader is not None and reader is not threading.current_thread():
            reader.join(CONNECT_S)
        if self._served_here:
            self._served_here = False
            release(self._name)
