"""What a participant has to send: submessages, packed into as few datagrams as fit."""

from __future__ import annotations

from collections.abc import Callable, Collection

from msbot_agent.space.contract import Guid
from msbot_agent.space.rtps import wire
from msbot_agent.space.rtps.descriptions import Address
from msbot_agent.space.rtps.reader import WriterProxy
from msbot_agent.space.rtps.wire import Prefix
from msbot_agent.space.rtps.writer import ReaderProxy
from msbot_xrce.common.tally import Tally

LARGEST_DATAGRAM = 1400
"""Several submessages go into one datagram up to this size."""
MAX_OUTBOX = 4096
"""Datagrams that wait; more are dropped, as the network might, and are asked for again."""


class RtpsOutbox:
    """Datagrams on their way out."""

    def __init__(self, prefix: Prefix, dropped: Tally, epoch_ns: Callable[[], int]) -> None:
        self.datagrams: list[tuple[bytes, Address]] = []
        self._dropped = dropped
        self._header = wire.header(prefix)
        self._epoch_ns = epoch_ns

    def to_reader(self, proxy: ReaderProxy, said: list[bytes]) -> None:
        """For a reader elsewhere: samples, and what is to be said of them."""
        self._send(proxy.guid, proxy.locators, said, wire.info_ts(self._epoch_ns()))

    def to_writer(self, proxy: WriterProxy, said: list[bytes]) -> None:
        """For a writer elsewhere: what is there and what is missing."""
        self._send(proxy.guid, proxy.locators, said, b"")

    def post(self, said: list[bytes], address: Address, front: Collection[bytes] = ()) -> None:
        """Pack submessages into datagrams, each with the same front."""
        begin = self._header + b"".join(front)
        datagram = begin
        for submessage in said:
            if len(datagram) + len(submessage) > LARGEST_DATAGRAM and len(datagram) > len(begin):
                self._leave(datagram, address)
                datagram = begin
            datagram += submessage
        if len(datagram) > len(begin):
            self._leave(datagram, address)

    def _send(self, guid: Guid, locators: tuple[Address, ...], said: list[bytes], stamp: bytes) -> None:
        for address in locators:
            self.post(said, address, (wire.info_dst(guid[:12]), stamp))

    def _leave(self, datagram: bytes, address: Address) -> None:
        if len(self.datagrams) >= MAX_OUTBOX:
            self._dropped.count(f"more than {MAX_OUTBOX} datagrams wait")
        else:
            self.datagrams.append((datagram, address))
