"""What simulated devices share: a node of the library with an object dictionary, PDOs that it sends, boot-up."""

from __future__ import annotations

import logging
import time
from abc import abstractmethod
from collections.abc import Mapping, Sequence
from typing import Any, Final

import canopen
from canopen.objectdictionary import (
    INTEGER8,
    INTEGER16,
    INTEGER32,
    UNSIGNED8,
    UNSIGNED16,
    UNSIGNED32,
    VISIBLE_STRING,
    ObjectDictionary,
    ODArray,
    ODRecord,
    ODVariable,
)

import can
from msbot_bridges.bridge import ThreadedDevice
from msbot_bridges.canbus import open_bus
from msbot_bridges.canopen.canopen_bus import HEARTBEAT, SYNC_ID, BridgeNetwork
from msbot_bridges.canopen.lss import ANSWER_ID as LSS_ANSWER
from msbot_bridges.canopen.lss import REQUEST_ID as LSS_REQUEST
from msbot_bridges.canopen.lss import LssAddress
from msbot_bridges.canopen.objects import GUARD_TIME, PRODUCT, REVISION, SERIAL, VENDOR, Entry
from msbot_bridges.canopen.simulated.lss_slave import LssSlave
from msbot_xrce.errors import LinkDown

STEP_S: Final = 0.01
AGAIN_S: Final = 10.0
"""Longest wait for a bus that has another bit rate than it has itself."""
OPERATIONAL: Final = 5
SYNCHRONOUS: Final = 240
"""Up to this transmission type a PDO is sent with every so many SYNCs."""
MOST_OCTETS: Final = 4096
"""Of a value that is written to it piece by piece."""
_log = logging.getLogger("msbot.part")
_KINDS: Final = {
    (8, False): UNSIGNED8,
    (16, False): UNSIGNED16,
    (32, False): UNSIGNED32,
    (8, True): INTEGER8,
    (16, True): INTEGER16,
    (32, True): INTEGER32,
}


def at_bit_rate(address: str, bit_rate: int | None) -> str:
    """The address of the same bus at another bit rate; None: at that which it has."""
    path = address.partition("?")[0]
    return address if bit_rate is None else f"{path}?bitrate={bit_rate}"


def add(dictionary: ObjectDictionary, name: str, entry: Entry, value: int, *, is_writable: bool = True) -> None:
    """Add a number with a value of its own; a subindex makes it a member of a record."""
    one = ODVariable(name, entry.index, entry.subindex)
    one.data_type = _KINDS[entry.bits, entry.signed]
    one.access_type = "rw" if is_writable else "ro"
    one.default = value
    if entry.subindex == 0:
        dictionary.add_object(one)
        return
    record = dictionary.get(entry.index)
    if not isinstance(record, ODRecord):
        record = ODRecord(name.partition(" ")[0], entry.index)
        count = ODVariable("Number of entries", entry.index, 0)
        count.data_type, count.access_type, count.default = UNSIGNED8, "rw", 0
        record.add_member(count)
        dictionary.add_object(record)
    record.add_member(one)
    record[0].default = max(record[0].default, entry.subindex)


def add_text(dictionary: ObjectDictionary, name: str, index: int, text: str) -> None:
    """Add a text."""
    one = ODVariable(name, index)
    one.data_type, one.access_type, one.default = VISIBLE_STRING, "const", text
    dictionary.add_object(one)


def add_pdos(dictionary: ObjectDictionary, node_id: int, sent: Sequence[int], received: Sequence[int]) -> None:
    """Add PDOs, each with room for eight entries and none mapped; the numbers count from 1."""
    for communication, mapping, base, numbers in (
        (0x1800, 0x1A00, 0x180, sent),
        (0x1400, 0x1600, 0x200, received),
    ):
        for number in numbers:
            at = communication + number - 1
            cob_id = 1 << 31 | base + 0x100 * (number - 1) + node_id
            add(dictionary, f"PDO{at:x} identifier", Entry(at, 1, 32), cob_id)
            add(dictionary, f"PDO{at:x} transmission type", Entry(at, 2, 8), 255)
            if communication == 0x1800:
                add(dictionary, f"PDO{at:x} inhibit time", Entry(at, 3, 16), 0)
                add(dictionary, f"PDO{at:x} event timer", Entry(at, 5, 16), 0)
            array = ODArray(f"Mapping{at:x}", mapping + number - 1)
            for subindex in range(9):
                one = ODVariable(f"Entry {subindex}", mapping + number - 1, subindex)
                one.data_type, one.default = UNSIGNED32 if subindex else UNSIGNED8, 0
                array.add_member(one)
            dictionary.add_object(array)


class LocalDevice(ThreadedDevice):
    """A simulated device.

    Args:
        address: `INTERFACE:CHANNEL[?bitrate=N]` of python-can.
        node_id: where it is on its bus.
        dictionary: its objects.
    """

    def __init__(self, address: str, node_id: int, dictionary: ObjectDictionary) -> None:
        super().__init__()
        self.node = canopen.LocalNode(node_id, dictionary)
        self.slave = LssSlave(self.lss_address)
        self.slave.node_id = node_id
        self._address = address
        self._sent_at = dict[int, float]()
        self._sent = dict[int, bytes]()
        self._state = 0
        self._toggle = 0
        self._syncs = 0
        self.failures = 0
        """How often what was written into its dictionary made no sense."""
        self._syncs_sent = dict[int, int]()
        """How many SYNCs there were when each PDO was sent."""

    def run_in_thread(self) -> None:
        """Run until `end`; at another bit rate, once it was told so.

        Raises:
            LinkDown: the bus cannot be opened, or has ended.
        """
        bus = open_bus(self._address)
        while True:
            self._run_on(bus)
            pause_ms, self.slave.switches_after_ms = self.slave.switches_after_ms, None
            if self._ended.is_set() or pause_ms is None or self._ended.wait(2 * pause_ms / 1000):
                return
            self._address = at_bit_rate(self._address, self.slave.bit_rate)
            bus = self._opened_again()

    def _opened_again(self) -> can.BusABC:
        """Others may still be on their way to the new bit rate."""
        until = time.monotonic() + AGAIN_S
        while True:
            try:
                return open_bus(self._address)
            except LinkDown:
                if time.monotonic() > until or self._ended.wait(STEP_S):
                    raise

    def _run_on(self, bus: can.BusABC) -> None:
        network = BridgeNetwork(bus, self._frame, self._asked)
        try:
            network.connect()
            network.add_node(self.node)
            if self.node.nmt.state != "INITIALISING":
                self.node.nmt.start_heartbeat(int.from_bytes(self.node.get_data(0x1017, 0), "little"))
            while not self._ended.is_set() and self.slave.switches_after_ms is None:
                network.check()
                self._try_to_live()
                time.sleep(STEP_S)
        except can.CanError as error:
            raise LinkDown(f"{self._address}: {error}") from error
        finally:
            self.node.nmt.stop_heartbeat()
            network.disconnect()
            if self.node.id in network:
                del network[self.node.id]  # it may be on another one next

    # For the kinds

    @abstractmethod
    def step(self, seconds: float) -> None:
        """Live for a moment."""

    @abstractmethod
    def received(self, values: Mapping[tuple[int, int], int]) -> None:
        """A PDO has brought values, by index and subindex."""

    def get(self, entry: Entry) -> int:
        """A value of its dictionary."""
        return entry.decode(self.node.get_data(entry.index, entry.subindex))

    def put(self, entry: Entry, value: int) -> None:
        """Change a value of its dictionary."""
        self.node.set_data(entry.index, entry.subindex, entry.encode(value))

    @property
    def lss_address(self) -> LssAddress:
        """Who it is."""
        return LssAddress(*(self._number(one) for one in (VENDOR, PRODUCT, REVISION, SERIAL)))

    def _number(self, entry: Entry) -> int:
        """A value; 0: it has no such entry."""
        record = self.node.object_dictionary.get(entry.index)
        return self.get(entry) if record is not None and entry.subindex in record else 0

    @property
    def is_operational(self) -> bool:
        """Whether its PDOs are in use."""
        return self._state == OPERATIONAL

    # Inside

    def _frame(self, can_id: int, data: bytes) -> None:
        if can_id == SYNC_ID:
            self._syncs += 1
        elif can_id == LSS_REQUEST and len(data) == 8 and (answer := self.slave.received(data)) is not None:
            self.node.network.send_message(LSS_ANSWER, answer)

    def _asked(self, can_id: int) -> None:
        """Node guarding: the state, and a bit that is another one each time."""
        if can_id == HEARTBEAT + self.node.id and GUARD_TIME.index in self.node.object_dictionary:
            # It says OPERATIONAL when its PDOs are in use, which is a moment later than the library has it.
            state = OPERATIONAL if self.is_operational else 4 if self.node.nmt.state == "STOPPED" else 127
            self.node.network.send_message(can_id, bytes([state | self._toggle]))
            self._toggle ^= 0x80

    def _try_to_live(self) -> None:
        """Anybody may write anything into its dictionary: it goes on with what makes sense."""
        if len(self.node.sdo._buffer or b"") > MOST_OCTETS:  # noqa: SLF001 - pieces without end; it has no other way
            self.node.sdo._buffer = None  # noqa: SLF001
        try:
            self._live()
        except can.CanError:
            raise
        except Exception as error:  # of the library, or a number that is out of range
            self.failures += 1
            if self.failures == 1:
                _log.warning("%s: node %d cannot use its objects: %s", self._address, self.node.id, error)

    def _live(self) -> None:
        nmt = self.node.nmt
        if nmt.state == "INITIALISING":
            nmt.state = "INITIALISING"  # says boot-up
            nmt.state = "PRE-OPERATIONAL"
        is_operational = nmt.state == "OPERATIONAL"
        has_started = is_operational and not self.is_operational
        if has_started:
            self._use_pdos()
        self._state = OPERATIONAL if is_operational else 0
        if has_started:
            # The library's periodic message may go on with the state before.
            nmt.start_heartbeat(int.from_bytes(self.node.get_data(0x1017, 0), "little"))
        self.step(STEP_S)
        if self.is_operational:
            self._send_pdos(time.monotonic())

    def _use_pdos(self) -> None:
        self.node.tpdo.read()
        self.node.rpdo.read()
        for pdo in self.node.rpdo.values():
            if pdo.enabled and not pdo.callbacks:
                pdo.add_callback(self._take)
        self._sent_at.clear()

    def _take(self, pdo: Any) -> None:  # noqa: ANN401 - the library has no types
        if self.is_operational:
            self.received({(variable.index, variable.subindex): variable.raw for variable in pdo})

    def _send_pdos(self, now: float) -> None:
        for number, pdo in self.node.tpdo.items():
            if not pdo.enabled or not len(pdo):
                continue
            for variable in pdo:
                variable.set_data(self.node.get_data(variable.index, variable.subindex))
            if (every := pdo.trans_type or 0) and every <= SYNCHRONOUS:
                if self._syncs - self._syncs_sent.get(number, 0) >= every:
                    self._syncs_sent[number] = self._syncs
                    pdo.transmit()
                continue
            data, period = bytes(pdo.data), (pdo.event_timer or 0) / 1000
            is_due = now - self._sent_at.get(number, 0.0) >= period if period else False
            if is_due or (not period and data != self._sent.get(number)) or number not in self._sent_at:
                self._sent_at[number], self._sent[number] = now, data
                pdo.transmit()
