"""Gives all devices of a CANopen bus another bit rate, once: looks who is there, asks a person, changes, keeps.

No bridge is on the bus meanwhile. It is refused, before anything has changed, when somebody is there who cannot have
that bit rate or cannot be told it: it would disturb everybody else afterwards. Waits for the bus: in no event loop.
"""

from __future__ import annotations

import queue
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from typing import Final

import canopen
from canopen.sdo import SdoCommunicationError

import can
from msbot_bridges.canbus import BEACON_ID, open_bus
from msbot_bridges.canopen.canopen_bus import HEARTBEAT, SDO_ANSWER, SDO_REQUEST, BridgeNetwork
from msbot_bridges.canopen.canopen_device import ENTER_PRE_OPERATIONAL, OWN_ID
from msbot_bridges.canopen.lss import (
    ANSWER_ID,
    ANSWER_S,
    REQUEST_ID,
    LssAddress,
    LssFailure,
    LssQuestion,
    any_unnumbered,
)
from msbot_bridges.canopen.lss_bit_rates import (
    BIT_RATES,
    SWITCH_MS,
    Asking,
    all_are_waiting,
    change,
    is_there,
    keep,
    set_rate,
)
from msbot_bridges.canopen.objects import PRODUCT, REVISION, SERIAL, VENDOR
from msbot_bridges.canopen.sdo_requests import SdoRefused, SdoRequests
from msbot_xrce.errors import ConfigError, LinkDown

LISTEN_S: Final = 2.0
"""So long the bus is listened to before the question, and devices are waited for that are asked who they are."""
RETURN_S: Final = 120.0
"""Longest wait until all devices answer at the new bit rate: a person may have to set the adapter's."""
AGAIN_S: Final = 0.5
TIMES: Final = 3
"""So often a device is asked that does not answer."""
_WHO_ARE_YOU: Final = b"\x40\x00\x10\x00\0\0\0\0"
_BY_SYSTEM: Final = "socketcan"
"""Interfaces whose bit rate only the system can set."""


class _Ears(can.Listener):
    """What is on the bus, heard in the library's thread."""

    def __init__(self) -> None:
        self.nodes = set[int]()
        self.others = ""
        """Who is there besides devices of CANopen, as a sentence."""
        self.answers = queue.Queue[bytes](100)

    def on_message_received(self, msg: can.Message) -> None:
        if msg.is_error_frame or msg.is_remote_frame:
            return
        if msg.is_extended_id:
            self.others = f"frames with 29 bits are on this bus (0x{msg.arbitration_id:08X}), from no CANopen device"
        elif msg.arbitration_id == BEACON_ID:
            self.others = "a robot of MsBOT is on this bus"
        elif msg.arbitration_id == HEARTBEAT + OWN_ID:
            self.others = "a bridge is on this bus: end it first"
        elif msg.arbitration_id == ANSWER_ID:
            if len(msg.data) == 8 and not self.answers.full():
                self.answers.put_nowait(bytes(msg.data))
        elif msg.arbitration_id & 0x780 in (HEARTBEAT, SDO_ANSWER) and 0 < msg.arbitration_id & 0x7F < OWN_ID:
            self.nodes.add(msg.arbitration_id & 0x7F)

    def stop(self) -> None:
        """See `can.Listener`."""


class BitRateChange:
    """One change.

    Args:
        address: `INTERFACE:CHANNEL?bitrate=N` of python-can, with the bit rate that the bus has now.
        bit_rate: the new one.

    Raises:
        ConfigError: there is no such bit rate, or the address does not name the present one.
    """

    def __init__(self, address: str, bit_rate: int) -> None:
        path, _, query = address.partition("?")
        now = dict(pair.partition("=")[::2] for pair in query.split("&") if pair).get("bitrate", "")
        if not now:
            raise ConfigError(f"--link {address}: say which bit rate the bus has now: {path}?bitrate=500000")
        for rate in (int(now), bit_rate):
            if rate not in BIT_RATES:
                known = ", ".join(map(str, BIT_RATES))
                raise ConfigError(f"devices of CANopen have no {rate} bit/s, but one of {known}")
        if int(now) == bit_rate:
            raise ConfigError(f"the bus has {bit_rate} bit/s already")
        self._address, self._new_address = address, f"{path}?bitrate={bit_rate}"
        self._before, self._bit_rate = int(now), bit_rate
        self._found: dict[int, LssAddress] = {}

    def prepare(self) -> str:
        """Tell each device, without a change yet; returns what a person is to agree to.

        Raises:
            LssFailure: somebody on the bus cannot have the bit rate; all have the old one.
            LinkDown: the bus cannot be opened.
        """
        with self._on_bus(self._address) as (network, ears):
            self._look(network, ears)
            told = list[int]()
            for node_id, who in self._found.items():
                if why := self._ask_often(network, ears, partial(set_rate, who, self._bit_rate)):
                    self._take_back(network, ears, told)
                    raise LssFailure(
                        f"node {node_id} ({who}) {why}; with it on the bus, the others keep {self._before} bit/s, too"
                    )
                told.append(node_id)
        nodes = ", ".join(map(str, sorted(self._found)))
        return (
            f"nodes {nodes} are to have {self._bit_rate} bit/s instead of {self._before}, and to keep it. "
            "Whoever else is on this bus and was not heard, must be set to it, too"
        )

    def undo(self) -> None:
        """The person does not agree: the devices are told that they keep the rate that they have."""
        with self._on_bus(self._address) as (network, ears):
            self._take_back(network, ears, list(self._found))

    def carry_out(self, say: Callable[[str], None]) -> None:
        """Change, wait until all devices answer at the new bit rate, and have them keep it.

        Args:
            say: takes what a person should know meanwhile.

        Raises:
            LssFailure: one does not answer there; none has kept it.
        """
        with self._on_bus(self._address) as (network, ears):
            network.send_message(0, bytes([ENTER_PRE_OPERATIONAL, 0]))  # nothing moves while they change
            self._ask(network, ears, change())
        interface, _, channel = self._address.partition("?")[0].partition(":")
        if interface == _BY_SYSTEM:
            say(
                f"the devices have {self._bit_rate} bit/s now; set the interface, too: "
                f"sudo ip link set {channel} down; sudo ip link set {channel} up type can bitrate {self._bit_rate}"
            )
        time.sleep(2 * SWITCH_MS / 1000 + AGAIN_S)  # the devices are there first
        until = time.monotonic() + RETURN_S
        while (missing := self._missing()) and time.monotonic() < until:
            time.sleep(AGAIN_S)
        if missing:
            raise LssFailure(
                f"{missing}; no device was told to keep {self._bit_rate} bit/s: switch all off and on, and they have "
                f"{self._before} again"
            )
        with self._on_bus(self._new_address) as (network, ears):
            for node_id, who in self._found.items():
                why = self._ask_often(network, ears, partial(keep, who))
                say(f"node {node_id} ({who}) {why or f'has {self._bit_rate} bit/s, and keeps it'}")
            self._ask(network, ears, all_are_waiting())

    def _look(self, network: BridgeNetwork, ears: _Ears) -> None:
        for node_id in range(1, OWN_ID):
            network.send_message(SDO_REQUEST + node_id, _WHO_ARE_YOU)
        time.sleep(LISTEN_S)
        if ears.others:
            raise LssFailure(f"{ears.others}; it would be left at {self._before} bit/s")
        if not ears.nodes:
            raise LssFailure(f"nobody answers on {self._address}: is this the bit rate that the bus has now?")
        for node_id in sorted(ears.nodes):
            node = network.add_node(canopen.RemoteNode(node_id, canopen.ObjectDictionary()))
            try:
                ask = SdoRequests(node)
                vendor, *others = (ask.number(entry) for entry in (VENDOR, PRODUCT, REVISION, SERIAL))
            except (SdoCommunicationError, SdoRefused) as error:
                raise LssFailure(f"node {node_id} does not say who it is (0x1018): {error}") from error
            if vendor is None:
                raise LssFailure(f"node {node_id} has no identity (0x1018), by which LSS could tell it its bit rate")
            self._found[node_id] = LssAddress(vendor, *(one or 0 for one in others))
        if self._ask(network, ears, any_unnumbered()):
            raise LssFailure("a device without a node id is on this bus: let a bridge give it one first")

    def _take_back(self, network: BridgeNetwork, ears: _Ears, nodes: list[int]) -> None:
        for node_id in nodes:
            self._ask_often(network, ears, partial(set_rate, self._found[node_id], self._before))

    def _missing(self) -> str:
        """Which device does not answer at the new bit rate, as a sentence; empty: all do."""
        try:
            with self._on_bus(self._new_address) as (network, ears):
                for node_id, who in self._found.items():
                    if why := self._ask(network, ears, is_there(who)):
                        return f"node {node_id} ({who}) {why} at {self._bit_rate} bit/s"
        except (LinkDown, can.CanError) as error:  # the interface may be down just now
            return str(error)
        return ""

    def _ask_often(self, network: BridgeNetwork, ears: _Ears, make: Callable[[], Asking]) -> str:
        why = ""
        for _ in range(TIMES):
            why = self._ask(network, ears, make())
            if "answer" not in why:
                break
        return why

    @staticmethod
    def _ask(network: BridgeNetwork, ears: _Ears, asking: Asking) -> str:
        answer: bytes | None = None
        try:
            question: LssQuestion = next(asking)
            while True:
                while not ears.answers.empty():  # of a device that was slow
                    ears.answers.get_nowait()
                network.send_message(REQUEST_ID, question.data)
                answer = None
                if question.is_answered:
                    try:
                        answer = ears.answers.get(timeout=ANSWER_S)
                    except queue.Empty:
                        answer = None
                question = asking.send(answer)
        except StopIteration as end:
            return str(end.value)

    @staticmethod
    @contextmanager
    def _on_bus(address: str) -> Iterator[tuple[BridgeNetwork, _Ears]]:
        network, ears = BridgeNetwork(open_bus(address), lambda _id, _data: None), _Ears()
        network.listeners.append(ears)
        try:
            network.connect()
            yield network, ears
        except can.CanError as error:
            raise LinkDown(f"{address}: {error}") from error
        finally:
            network.disconnect()
