"""How busy a live bus is, second by second and identifier by identifier: `msbot bus load ADDRESS`."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Callable, Iterable
from dataclasses import field
from math import ceil
from typing import Final

from msbot.cli.bus.source import Listening, open_bus
from msbot_agent.link.can.protocol import NODES, CanIds, Frame, frame_bits, is_joining
from msbot_agent.process.event_loop import run_to_end
from msbot_xrce.common.amount import amount
from msbot_xrce.common.lazy_dataclass import dataclass
from msbot_xrce.errors import ConfigError, LocalProtocolError

WINDOW_S: Final = 1.0
"""The load is measured over one second; over more where this process stood still."""
MOST_ROWS: Final = 16
"""Most identifiers shown for a second; the rest is summed up."""

_IDS = CanIds()


@dataclass(slots=True)
class Traffic:
    """What was heard of one identifier."""

    who: str
    frames: int = 0
    bits: int = 0
    busy_s: float = 0.0


@dataclass(slots=True)
class Second:
    """What was heard in one second."""

    by_id: dict[str, Traffic] = field(default_factory=dict)
    """By identifier as it is written: 3 hexadecimal digits, 8 for an extended one."""
    uncounted: int = 0
    """Reports of errors and the like, which are not frames of the bus."""

    def add(self, frame: Frame, bitrate: int, data_bitrate: int | None) -> None:
        """One frame."""
        try:
            length = frame_bits(frame)
        except LocalProtocolError:
            self.uncounted += 1
            return
        digits = f"{frame.can_id:08X}" if frame.extended else f"{frame.can_id:03X}"
        traffic = self.by_id.get(digits)
        if traffic is None:
            traffic = self.by_id[digits] = Traffic(who_says(frame))
        traffic.frames += 1
        traffic.bits += sum(length)
        traffic.busy_s += length.seconds(bitrate, data_bitrate)

    def total(self) -> Traffic:
        """All identifiers together."""
        return _sum("together", self.by_id.values())

    def rows(self) -> list[tuple[str, Traffic]]:
        """The busiest identifiers first, the rest in one row."""
        ordered = sorted(self.by_id.items(), key=lambda item: (-item[1].busy_s, item[0]))
        rest = [traffic for _, traffic in ordered[MOST_ROWS:]]
        return ordered[:MOST_ROWS] + ([("", _sum(f"{len(rest)} more", rest))] if rest else [])


def who_says(frame: Frame) -> str:
    """Who sends frames with this identifier, if it is one of ours."""
    if not frame.extended:
        for base, words in ((_IDS.up, "node {} to master"), (_IDS.down, "master to node {}")):
            if 0 < frame.can_id - base <= NODES:
                return words.format(frame.can_id - base)
        if frame.can_id in (_IDS.beacon, _IDS.stop):
            return "BEACON" if frame.can_id == _IDS.beacon else "STOP"
    elif is_joining(frame, _IDS):
        return "joining"
    return "foreign"


def show_load(
    address: str, *, bitrate: int, data_bitrate: int, seconds: float | None, as_json: bool,
    say: Callable[[str], None], complain: Callable[[str], None],
) -> None:  # fmt: skip
    """Print every second how busy a bus is, until Ctrl-C.

    Args:
        address: the bus.
        bitrate: nominal bit rate, used when the bus does not report its own.
        data_bitrate: the same for the data phase of CAN FD.
        seconds: stop after this time.
        as_json: one JSON object for each second.
        say: takes a line of the answer.
        complain: takes what goes wrong on the bus.

    Raises:
        ConfigError: the address makes no sense.
        LinkDown: the bus cannot be opened; the text names the remedy.
    """
    show = _as_json if as_json else _as_text
    run_to_end(_main(address, bitrate, data_bitrate, seconds, lambda *what: say(show(*what)), complain=complain))


async def _main(
    address: str, bitrate: int, data_bitrate: int, seconds: float | None,
    tell: Callable[[float, float, Second, int], None], *, complain: Callable[[str], None],
) -> None:  # fmt: skip
    bus = open_bus(address, node="load", listen_only=True)
    bitrate = bus.info.bits_per_second or bitrate
    fast = (bus.info.data_bits_per_second or data_bitrate) if bus.info.fd else None
    if fast is not None and fast < bitrate:
        raise ConfigError(f"--data-bitrate {fast} is below the nominal bit rate {bitrate}")
    listening = Listening(bus, complain)
    second = Second()
    listening.on_frame(lambda frame, _at: second.add(frame, bitrate, fast))

    async def report() -> None:
        nonlocal second
        await listening.opened.wait()
        loop = asyncio.get_running_loop()
        started_at = began_at = loop.time()
        second = Second()
        number = 0
        while seconds is None or number < seconds:
            # A second that has passed while the loop stood still is not told: what came then was not read in time. It
            # counts in the next one, which lasts from what was told last and has at least half a second still to come.
            passed = (loop.time() - started_at) / WINDOW_S
            number = max(number + 1, ceil(passed + 0.5))
            await asyncio.sleep(started_at + number * WINDOW_S - loop.time())
            now = loop.time()
            heard, second = second, Second()
            tell(now - started_at, now - began_at, heard, bitrate)
            began_at = now

    await listening.run_with(report())


def _as_text(at_s: float, length_s: float, second: Second, bitrate: int) -> str:
    total = second.total()
    frames = amount(total.frames, "frame")
    head = f"{at_s:6.0f} s   load {total.busy_s / length_s:7.2%} of {bitrate / 1000:g} kbit/s   {frames}"
    lines = [head + (f"   {amount(second.uncounted, 'report')} of errors" if second.uncounted else "")]
    lines += [
        f"  {digits:>8}  {traffic.who:18}  {traffic.frames:6} frames  {traffic.bits:8} bits  "
        f"{traffic.busy_s / length_s:7.2%}"
        for digits, traffic in second.rows()
    ]
    return "\n".join(lines)


def _as_json(at_s: float, length_s: float, second: Second, bitrate: int) -> str:
    total = second.total()
    return json.dumps(
        {
            "at_s": round(at_s, 3),
            "length_s": round(length_s, 6),
            "bitrate": bitrate,
            "load_percent": round(100 * total.busy_s / length_s, 4),
            "frames": total.frames,
            "bits": total.bits,
            "reports": second.uncounted,
            "by_id": {
                digits: {
                    "who": traffic.who,
                    "frames": traffic.frames,
                    "bits": traffic.bits,
                    "load_percent": round(100 * traffic.busy_s / length_s, 4),
                }
                for digits, traffic in sorted(second.by_id.items())
            },
        }
    )


def _sum(who: str, parts: Iterable[Traffic]) -> Traffic:
    whole = Traffic(who)
    for part in parts:
        whole.frames += part.frames
        whole.bits += part.bits
        whole.busy_s += part.busy_s
    return whole
