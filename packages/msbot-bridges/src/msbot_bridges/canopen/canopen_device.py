"""What all CANopen devices have in common: life, NMT, emergencies, settings, and a STOP in two steps.

STOP goes like this. First the device's own way to stop is told it: a drive by quick stop, outputs by their safe values;
the device itself has to report that this is done. Then NMT takes it out of OPERATIONAL, so that no PDO of anybody moves
it; its heartbeat has to report that. In PRE-OPERATIONAL, unlike STOPPED, settings still reach it.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Mapping, Sequence
from typing import Final, Protocol

from msbot.part import Message
from msbot_bridges.bridge import ForeignDevice, Report
from msbot_bridges.canopen import objects
from msbot_bridges.canopen.emergency_words import emergency_words, is_reset
from msbot_bridges.canopen.node_description import NodeDescription
from msbot_bridges.canopen.objects import Entry
from msbot_bridges.canopen.pdo_layout import PdoLayout
from msbot_bridges.canopen.sdo_requests import SdoRequests
from msbot_xrce.lazy import dataclass

START, ENTER_PRE_OPERATIONAL = 1, 128
"""Commands of NMT."""
OPERATIONAL, PRE_OPERATIONAL, STOPPED = 5, 127, 4
"""States of NMT, as a heartbeat has them."""
OWN_ID: Final = 127
"""The bridge's own node id: the highest, so that its heartbeat yields to all others."""
HEARTBEAT_MS: Final = 500
"""What a device that sends no heartbeat is told to send."""
GUARD_MS: Final = 500
"""A device that sends none is asked for its state so often (node guarding)."""
LIFE_FACTOR: Final = 3
BRIDGE_LOST_MS: Final = 1000
"""A device that watches heartbeats acts by itself when the bridge has been silent for so long."""


class NodeBus(Protocol):
    """What a device uses of its bus; returns at once."""

    def send(self, node_id: int, layout: PdoLayout, data: bytes, *, urgent: bool = False) -> None:
        """Send a PDO to a node."""

    def command(self, node_id: int, command: int, *, urgent: bool = False) -> None:
        """Send a command of NMT."""

    def guard(self, node_id: int) -> None:
        """Ask a node for its state of NMT (node guarding), which comes as a heartbeat does."""

    def synchronise(self, node_id: int, *, is_needed: bool) -> None:
        """A node has PDOs that need SYNC, or is no longer in the robot."""

    def set_up(self, device: CanopenDevice) -> None:
        """Call `configure` in the thread that may wait, then `configured` or `failed` in the event loop."""

    def read(self, device: CanopenDevice, entries: Sequence[Entry], stop: int = 0) -> None:
        """Read entries, then call `reported`; of several calls that wait, one is carried out.

        Args:
            device: what is asked, after all orders that it was given before.
            entries: what it is asked for.
            stop: which STOP the answer is about, for `reported`; 0: none.
        """

    def write(self, device: CanopenDevice, entry: Entry, value: int, *, urgent: bool = False) -> None:
        """Write an entry; what the device refuses is named in the log."""


@dataclass(frozen=True, slots=True)
class SetUp:
    """The PDOs of a device that is ready."""

    reports: tuple[PdoLayout, ...]
    """What it sends."""
    orders: tuple[PdoLayout, ...]
    """What it receives."""
    heartbeat_ms: int

    @property
    def is_synchronous(self) -> bool:
        """Whether one of them waits for SYNC."""
        return any(one.is_synchronous for one in (*self.reports, *self.orders))


class CanopenDevice(ForeignDevice):
    """One node.

    Args:
        description: what it says of itself.
        bus: the way to it.
        news: called when it has reported something.
    """

    def __init__(self, description: NodeDescription, bus: NodeBus, news: Callable[[ForeignDevice], None]) -> None:
        self.description = description
        self.identity = description.identity
        self.settings = tuple(description.declared)
        self.node_id = description.node_id
        self.nmt_state: int | None = None
        """What its newest heartbeat says; None: it has sent none."""
        self.is_stopping = False
        self._bus, self._news = bus, news
        self._entries = {one.name: one for one in description.settings}
        self._report: Report | None = None
        self._set_up: SetUp | None = None
        self._stop_number = 0
        """Which STOP holds, or held last."""
        self._is_still = False
        """The device has reported since STOP that it has stopped in its own way."""
        self._is_out = False
        """It has reported since then that it is not OPERATIONAL."""
        self._is_starting = False
        """It was told to be OPERATIONAL, and has not reported it: a heartbeat may be of the time before."""
        self._emergency = description.emergency
        self._trouble = ""

    # What a device of each kind does itself

    @abstractmethod
    def configure(self, ask: SdoRequests) -> SetUp:
        """Map PDOs; called in a thread, may wait.

        Raises:
            SdoRefused: the device does not take it.
        """

    @abstractmethod
    def still_entries(self) -> Sequence[Entry]:
        """What says that it has stopped in its own way."""

    @abstractmethod
    def tell_still(self) -> None:
        """Tell it to stop in its own way, before all other orders."""

    @abstractmethod
    def told(self, values: Mapping[Entry, int], *, is_answer: bool = False) -> None:
        """It has reported these values.

        Args:
            values: what it has reported.
            is_answer: it was asked for them after STOP, so that they say what became of that. Other reports may have
                been on their way when STOP came.
        """

    @abstractmethod
    def started(self) -> None:
        """It has reported that it is OPERATIONAL."""

    @property
    @abstractmethod
    def not_still(self) -> str:
        """What it has not reported yet."""

    # The contract

    def begin(self, report: Report) -> None:
        """See `ForeignDevice`."""
        self._report = report
        self._bus.set_up(self)

    def end(self) -> None:
        """See `ForeignDevice`."""
        self._report = self._set_up = None
        self.is_stopping = False
        self._bus.synchronise(self.node_id, is_needed=False)
        self._bus.command(self.node_id, ENTER_PRE_OPERATIONAL)

    def set(self, name: str, value: object) -> None:
        """See `ForeignDevice`."""
        setting = self._entries[name]
        assert isinstance(value, int | float)
        self._bus.write(self, setting.entry, round(value / setting.factor))

    def stop(self) -> None:
        """See `ForeignDevice`."""
        if not self.is_stopping:
            self.is_stopping, self._is_still, self._is_out = True, not self.inputs, not self.inputs
            self._stop_number += 1
        if not self._is_still:
            self.tell_still()
            self.ask_still()
        elif not self._is_out:
            self._bus.command(self.node_id, ENTER_PRE_OPERATIONAL, urgent=True)
            if not self.heartbeat_ms:
                self._bus.guard(self.node_id)

    def leave(self) -> None:
        """See `ForeignDevice`: as at STOP, it reports that it is safe, and that no PDO moves it any more."""
        self.stop()

    def go(self) -> None:
        """See `ForeignDevice`."""
        self.is_stopping = False
        if self._set_up is not None and self.inputs:
            self._start()

    @property
    def not_stopped(self) -> str:
        """See `ForeignDevice`."""
        if not self.is_stopping or self._is_out:
            return ""
        return f"node {self.node_id} has not reported " + (
            f"by {'its heartbeat' if self.heartbeat_ms else 'node guarding'} that it is PRE-OPERATIONAL"
            if self._is_still
            else self.not_still
        )

    @property
    def fault(self) -> str:
        """See `ForeignDevice`."""
        if self._emergency:
            return f"node {self.node_id} reports {self._emergency}"
        return self._trouble

    # What its bus tells, in the event loop

    def configured(self, set_up: SetUp) -> None:
        """It is ready to be started."""
        if self._report is None:
            return
        self._set_up = set_up
        if set_up.is_synchronous:
            self._bus.synchronise(self.node_id, is_needed=True)
        if not self.is_stopping or not self.inputs:
            self._start()

    def failed(self, why: str) -> None:
        """It cannot be set up, or has not answered."""
        if self._report is not None and why != self._trouble:
            self._trouble = why
            self._news(self)

    def heartbeat(self, state: int) -> None:
        """Its heartbeat has come."""
        before, self.nmt_state = self.nmt_state, state
        if state == OPERATIONAL and before != OPERATIONAL:
            self.started()
        if state == OPERATIONAL:
            self._is_starting = False
        elif self.is_stopping and self._is_still and state in (PRE_OPERATIONAL, STOPPED) and not self._is_out:
            self._is_out, self._is_starting = not self._is_starting, False
            self._news(self)
        if self.fault:
            self._bus.read(self, self.still_entries())

    def emergency(self, code: int, register: int) -> None:
        """An emergency message has come; one without an error in its register is a warning."""
        words = "" if is_reset(code) or not register else emergency_words(code, register)
        if words != self._emergency:
            self._emergency = words
            self._news(self)

    def received(self, cob_id: int, data: bytes) -> None:
        """One of its PDOs has come."""
        for layout in () if self._set_up is None else self._set_up.reports:
            if layout.cob_id == cob_id:
                self.told(layout.unpack(data))

    def reported(self, values: Mapping[Entry, int], stop: int) -> None:
        """What was asked for by `read`."""
        self.told(values, is_answer=stop == self._stop_number and self.is_stopping)

    @property
    def heartbeat_ms(self) -> int:
        """Period of its heartbeat; 0: it sends none."""
        return self.description.heartbeat_ms if self._set_up is None else self._set_up.heartbeat_ms

    def _start(self) -> None:
        self._is_starting = self.nmt_state != OPERATIONAL
        self._bus.command(self.node_id, START)
        if not self.heartbeat_ms:
            self._bus.guard(self.node_id)  # so that it is known that PDOs reach it

    # For the kinds

    def report(self, port: str, message: Message) -> None:
        """Something goes out of a port."""
        if self._report is not None:
            self._report(port, message)

    def ask_still(self) -> None:
        """Ask whether it has stopped in its own way."""
        self._bus.read(self, self.still_entries(), self._stop_number)

    def confirm_still(self) -> None:
        """It has reported that it has stopped in its own way: the second step begins."""
        if self.is_stopping and not self._is_still:
            self._is_still = True
            self._bus.command(self.node_id, ENTER_PRE_OPERATIONAL, urgent=True)

    @property
    def is_waiting_to_be_still(self) -> bool:
        """STOP has come, and it has not reported that it has stopped in its own way."""
        return self.is_stopping and not self._is_still

    @property
    def is_operational(self) -> bool:
        """Whether PDOs reach it."""
        return self._set_up is not None and self.nmt_state == OPERATIONAL

    def order(self, values: Mapping[Entry, int], entry: Entry, *, urgent: bool = False) -> None:
        """Send the PDO that has an entry."""
        for layout in () if self._set_up is None else self._set_up.orders:
            if entry in layout.entries:
                self._bus.send(self.node_id, layout, layout.pack(values), urgent=urgent)
                return


def watch_each_other(ask: SdoRequests) -> int:
    """Have a device send its heartbeat and watch the bridge's, where it can; the period in ms, 0: it sends none.

    One that sends none is guarded, and acts by itself when the bridge has not asked for its state three times.
    """
    period = ask.number(objects.PRODUCER_HEARTBEAT) or 0
    if not period and ask.write_if_there(objects.PRODUCER_HEARTBEAT, HEARTBEAT_MS):
        period = HEARTBEAT_MS
    if not period and ask.write_if_there(objects.GUARD_TIME, GUARD_MS):
        ask.write_if_there(objects.LIFE_FACTOR, LIFE_FACTOR)
    ask.write_if_there(objects.CONSUMER_HEARTBEAT, OWN_ID << 16 | BRIDGE_LOST_MS)
    return period
