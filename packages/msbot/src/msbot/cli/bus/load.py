"""How busy a bus will be: `msbot bus load`."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import field
from math import ceil
from pathlib import Path
from typing import Final

from msbot.cli.bus.bus_source import Listening, open_bus
from msbot.cli.bus.foreign_frames import foreign_words
from msbot.cli.run.bridges_beside import BridgeBus, bridge_buses
from msbot.config import Blueprint, Library, open_blueprint
from msbot.pnp import Flow, Forecast, forecast
from msbot_agent.link.can.protocol import (
    NODES,
    CanIds,
    Frame,
    FrameBits,
    Framing,
    frame_bits,
    is_joining,
    parse_frame,
    phase_bits,
    wire_bits,
)
from msbot_agent.process.end_signals import run_to_end
from msbot_xrce import compress
from msbot_xrce.counting import amount
from msbot_xrce.errors import ConfigError, LocalProtocolError
from msbot_xrce.lazy import dataclass

BITRATES = (125_000, 250_000, 500_000, 1_000_000)
"""Shown for comparison."""
MOST_PARTS = 120
FULL = 0.8
"""Above this a bus has no room for what a forecast leaves out."""


@dataclass(frozen=True, slots=True)
class Bus:
    """The bus for which the forecast is made."""

    bitrate: int
    data_bitrate: int
    fd: bool
    compression: bool

    def framing(self, *, compression: bool) -> Framing:
        """How messages become frames on it."""
        return Framing(self.fd, self.fd, compress if compression else None)

    def load(self, found: Forecast, bitrate: int | None = None) -> float:
        """Share of the time that the bus is busy, 1 = always."""
        return found.load(bitrate or self.bitrate, self.data_bitrate if self.fd else None)

    def describe(self) -> str:
        """The bus in words."""
        rates = f"{self.bitrate / 1000:g} kbit/s"
        if self.fd:
            return f"CAN FD at {rates} and {self.data_bitrate / 1000:g} kbit/s"
        return f"classic CAN at {rates}"


def load_report(path: Path, folders: Sequence[Path], bus: Bus, sizes: Mapping[str, int], *, as_json: bool) -> str:
    """The forecast of a blueprint, as a table in words or as JSON.

    Raises:
        ConfigError: the blueprint or the library is wrong.
    """
    blueprint, library = open_blueprint(path, *folders)
    found, other = (
        forecast(blueprint, library, bus.framing(compression=compression), sizes=sizes)
        for compression in (bus.compression, not bus.compression)
    )
    if as_json:
        return json.dumps(_forecast_as_json(blueprint, found, other, bus))
    bridged = [_bridge_words(one, bus.bitrate) for one in bridge_buses(blueprint)]
    return "\n".join([*_table(blueprint, found, bus), *_remarks(blueprint, found, other, bus), *bridged])


def _bridge_words(one: BridgeBus, otherwise: int) -> str:
    """A bus of bridges, which is not that of the robot's own parts."""
    bitrate = one.bitrate or otherwise
    load = one.bits_per_s / bitrate
    words = (
        f"Besides, {' and '.join(one.worlds)} on {one.address}, with {amount(one.devices, 'device')}: about "
        f"{one.frames_per_s:.0f} frames/s, {load:.1%} of {bitrate / 1000:g} kbit/s"
    )
    return f"{words}; that does not fit the bus." if load > 1 else f"{words}."


def crowded_buses(blueprint: Blueprint, library: Library, links: Sequence[str]) -> list[str]:
    """The buses of bridges that are busy nearly all the time; the robot's own parts count where they share one.

    Args:
        blueprint: names the bridges.
        library: the robot's part types.
        links: where its own parts come in.

    Raises:
        ConfigError: what is to be sent does not fit a bus.
    """
    told = []
    for one in bridge_buses(blueprint, links):
        if one.bitrate is None:
            continue  # nobody has said how fast it is
        load, who = one.bits_per_s / one.bitrate, [*one.worlds]
        if one.is_shared:
            load += forecast(blueprint, library, Framing(False, False, compress)).load(one.bitrate)
            who.append("the robot's own parts")
        words = f"{' and '.join(who)} on {one.address}: about {load:.0%} of {one.bitrate / 1000:g} kbit/s"
        if load > 1:
            raise ConfigError(f"{words}; that does not fit the bus: use more bits a second, or another bus")
        if load > FULL:
            told.append(f"{words}; that leaves too little room for frames that are sent again")
    return told


def _table(blueprint: Blueprint, found: Forecast, bus: Bus) -> list[str]:
    groups: dict[str, list[Flow]] = {}
    for flow in found.flows:
        groups.setdefault(flow.group, []).append(flow)
    width = max(map(len, groups))
    lines = [
        f"{blueprint.robot.name} with {amount(len(blueprint.slots), 'part')} on {bus.describe()}, "
        f"{'with' if bus.compression else 'without'} header compression",
        "",
        f"{''.ljust(width)}  messages/s  frames/s    bits/s    load",
    ]
    for group, flows in [*groups.items(), ("together", list(found.flows))]:
        frames = sum(flow.rate_hz * flow.cost.frames for flow in flows)
        bits = sum(flow.rate_hz * flow.cost.bits for flow in flows)
        load = bus.load(Forecast(tuple(flows), {}, ()))
        messages = sum(flow.rate_hz for flow in flows)
        lines.append(f"{group.ljust(width)}  {messages:10.1f}  {frames:8.1f}  {bits:8.0f}  {load:6.2%}")
    return lines


def _remarks(blueprint: Blueprint, found: Forecast, other: Forecast, bus: Bus) -> list[str]:
    loads = [f"{bitrate // 1000} kbit/s {bus.load(found, bitrate):.1%}" for bitrate in BITRATES]
    lines = ["", f"{'Without' if bus.compression else 'With'} header compression: {bus.load(other):.2%}."]
    if not bus.fd:
        lines.append(f"At other bit rates: {', '.join(loads)}.")
    for type_name, size in found.assumed.items():
        lines.append(
            f"Samples of {type_name} are taken for {size} bytes; say --size {type_name}=BYTES if they are not."
        )
    if found.on_event:
        lines.append(f"Not counted, because their port has no rate_hz: {', '.join(found.on_event)}.")
    if len(blueprint.slots) > MOST_PARTS:
        lines.append(f"A bus has addresses for {MOST_PARTS} parts.")
    if bus.load(found) > 1:
        lines.append("That does not fit the bus.")
    elif bus.load(found) > FULL:
        lines.append("That leaves too little room for parts that join, and for frames that are sent again.")
    return lines


def _forecast_as_json(blueprint: Blueprint, found: Forecast, other: Forecast, bus: Bus) -> dict[str, object]:
    with_it, without = (found, other) if bus.compression else (other, found)
    return {
        "robot": blueprint.robot.name,
        "parts": len(blueprint.slots),
        "bitrate": bus.bitrate,
        "data_bitrate": bus.data_bitrate if bus.fd else None,
        "compression": bus.compression,
        "load_percent": round(100 * bus.load(found), 4),
        "load_percent_with_compression": round(100 * bus.load(with_it), 4),
        "load_percent_without_compression": round(100 * bus.load(without), 4),
        "flows": [
            {
                "group": flow.group,
                "what": flow.what,
                "slot": flow.slot,
                "messages_per_s": flow.rate_hz,
                "frames": round(flow.cost.frames, 3),
                "nominal_bits": round(flow.cost.nominal_bits, 2),
                "data_bits": round(flow.cost.data_bits, 2),
            }
            for flow in found.flows
        ],
        "bridge_buses": [
            {
                "link": one.address,
                "worlds": list(one.worlds),
                "devices": one.devices,
                "frames_per_s": round(one.frames_per_s, 1),
                "load_percent": round(100 * one.bits_per_s / (one.bitrate or bus.bitrate), 4),
            }
            for one in bridge_buses(blueprint)
        ],
        "assumed_bytes": dict(found.assumed),
        "not_counted": list(found.on_event),
    }


# How busy a live bus is, second by second and identifier by identifier: `msbot bus load ADDRESS`.


WINDOW_S: Final = 1.0
"""The load is measured over one second; over more where this process stood still."""
MOST_ROWS: Final = 16
"""Most identifiers shown for a second; the rest is summed up."""

_IDS = CanIds()
FOREIGN: Final = "foreign"


class WhoSays:
    """Who sends frames with an identifier.

    Other equipment may have the identifiers of MsBOT's parts, but not on one bus with them. So what else is heard there
    decides: only a master of MsBOT sends BEACON, and only others send frames that are none of MsBOT's.

    Args:
        foreign: what a frame of other equipment says; empty: it is not known.
    """

    def __init__(self, foreign: Callable[[Frame], str]) -> None:
        self._foreign = foreign
        self._has_master = self._has_others = False

    def hear(self, frame: Frame) -> None:
        """A frame of an identifier that was not heard before, or again after a second."""
        said = who_says(frame)
        self._has_master |= said == "BEACON"
        self._has_others |= said == FOREIGN and bool(self._foreign(frame))

    def name(self, frame: Frame) -> str:
        """In a few words."""
        said = who_says(frame)
        if said == FOREIGN or (self._has_others and not self._has_master):
            words = self._foreign(frame)
            # The identifier decides what comes before the mark; the data of each frame, what comes behind it.
            return words.partition(", " if frame.extended else ":")[0] or said
        return said


@dataclass(slots=True)
class Traffic:
    """What was heard of one identifier."""

    who: str
    frame: Frame | None = None
    """One of its frames."""
    frames: int = 0
    bits: int = 0
    busy_s: float = 0.0


@dataclass(slots=True)
class Second:
    """What was heard in one second."""

    who: WhoSays = field(default_factory=lambda: WhoSays(lambda _: ""))
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
            self.who.hear(frame)
            traffic = self.by_id[digits] = Traffic(who_says(frame), frame)
        traffic.frames += 1
        traffic.bits += sum(length)
        traffic.busy_s += length.seconds(bitrate, data_bitrate)

    def name_all(self) -> None:
        """Say who has sent what was heard."""
        for traffic in self.by_id.values():
            assert traffic.frame is not None
            traffic.who = self.who.name(traffic.frame)

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
    return FOREIGN


def show_load(
    address: str,
    *,
    bitrate: int,
    data_bitrate: int,
    seconds: float | None,
    as_json: bool,
    say: Callable[[str], None],
    complain: Callable[[str], None],
) -> None:
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
    show = _measured_as_json if as_json else _as_text
    run_to_end(_main(address, bitrate, data_bitrate, seconds, lambda *what: say(show(*what)), complain=complain))


async def _main(
    address: str,
    bitrate: int,
    data_bitrate: int,
    seconds: float | None,
    tell: Callable[[float, float, Second, int], None],
    *,
    complain: Callable[[str], None],
) -> None:
    bus = open_bus(address, node="load", listen_only=True)
    bitrate = bus.info.bits_per_second or bitrate
    fast = (bus.info.data_bits_per_second or data_bitrate) if bus.info.fd else None
    if fast is not None and fast < bitrate:
        raise ConfigError(f"--data-bitrate {fast} is below the nominal bit rate {bitrate}")
    listening = Listening(bus, complain)
    who = WhoSays(foreign_words())
    second = Second(who)
    listening.on_frame(lambda frame, _at: second.add(frame, bitrate, fast))

    async def report() -> None:
        nonlocal second
        await listening.opened.wait()
        loop = asyncio.get_running_loop()
        started_at = began_at = loop.time()
        second = Second(who)
        number = 0
        while seconds is None or number < seconds:
            # A second that has passed while the loop stood still is not told: what came then was not read in time. It
            # counts in the next one, which lasts from what was told last and has at least half a second still to come.
            passed = (loop.time() - started_at) / WINDOW_S
            number = max(number + 1, ceil(passed + 0.5))
            await asyncio.sleep(started_at + number * WINDOW_S - loop.time())
            now = loop.time()
            heard, second = second, Second(who)
            heard.name_all()
            tell(now - started_at, now - began_at, heard, bitrate)
            began_at = now

    await listening.run_with(report())


def _as_text(at_s: float, length_s: float, second: Second, bitrate: int) -> str:
    total = second.total()
    frames = amount(total.frames, "frame")
    head = f"{at_s:6.0f} s   load {total.busy_s / length_s:7.2%} of {bitrate / 1000:g} kbit/s   {frames}"
    lines = [head + (f"   {amount(second.uncounted, 'report')} of errors" if second.uncounted else "")]
    rows = second.rows()
    width = max((len(traffic.who) for _, traffic in rows), default=0)
    lines += [
        f"  {digits:>8}  {traffic.who:{max(18, width)}}  {traffic.frames:6} frames  {traffic.bits:8} bits  "
        f"{traffic.busy_s / length_s:7.2%}"
        for digits, traffic in rows
    ]
    return "\n".join(lines)


def _measured_as_json(at_s: float, length_s: float, second: Second, bitrate: int) -> str:
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


# What frames cost on the wire: `msbot bus cost`.


TITLES = ("frame", "nominal bits", "data bits", "of these stuffed", "µs on the wire")


@dataclass(frozen=True, slots=True)
class FrameCost:
    """One frame and its bits."""

    text: str
    """The frame as it was written."""
    frame: Frame
    bits: FrameBits
    """The data phase of CAN FD, from ESI to the last bit of the CRC, is counted separately."""

    def microseconds(self, bitrate: int, data_bitrate: int) -> float:
        """Time on the wire at these bit rates (bit/s); without a bit-rate switch all bits take the nominal one."""
        return self.bits.seconds(bitrate, data_bitrate if self.frame.brs else bitrate) * 1e6

    def stuff_bits(self) -> int:
        """How many of the bits are stuff bits, dynamic and fixed."""
        return sum(bit.stuff for bit in wire_bits(self.frame))


def costs(texts: Sequence[str]) -> list[FrameCost]:
    """The cost of each frame.

    Raises:
        ConfigError: a frame is malformed; the text says what would be right.
        LocalProtocolError: a frame is an error report, which is never on the wire.
    """
    frames = [(text, parse_frame(text)) for text in texts]
    return [FrameCost(text, frame, phase_bits(frame)) for text, frame in frames]


def cost_json(texts: Sequence[str]) -> str:
    """The costs as a JSON list of objects, in the order of the frames."""
    return json.dumps(
        [
            {"frame": cost.text, "nominal_bits": cost.bits.nominal_bits, "data_bits": cost.bits.data_bits}
            for cost in costs(texts)
        ]
    )


def cost_table(texts: Sequence[str], bitrate: int, data_bitrate: int) -> str:
    """The costs as lines with columns, and their sum when there are several frames."""
    found = costs(texts)
    stuffed = [cost.stuff_bits() for cost in found]
    times = [cost.microseconds(bitrate, data_bitrate) for cost in found]
    rows = [
        (cost.text, cost.bits.nominal_bits, cost.bits.data_bits, stuff, time)
        for cost, stuff, time in zip(found, stuffed, times, strict=True)
    ]
    if len(rows) > 1:
        nominal, data = (sum(cost.bits[phase] for cost in found) for phase in (0, 1))
        rows.append(("together", nominal, data, sum(stuffed), sum(times)))
    width = max(len(row[0]) for row in (TITLES, *rows))
    lines = ["  ".join((TITLES[0].ljust(width), *TITLES[1:]))]
    for text, *numbers, time in rows:
        cells = [str(number).rjust(len(title)) for number, title in zip(numbers, TITLES[1:], strict=False)]
        lines.append("  ".join((text.ljust(width), *cells, f"{time:.2f}".rjust(len(TITLES[-1])))))
    return "\n".join(lines)
