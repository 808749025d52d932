"""How busy a bus will be: `msbot bus load`."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path

from msbot.config import Blueprint, open_blueprint
from msbot.pnp import Flow, Forecast, forecast
from msbot_agent.link.can.protocol import Framing
from msbot_xrce import compress
from msbot_xrce.common.amount import amount
from msbot_xrce.common.lazy_dataclass import dataclass

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

    def words(self) -> str:
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
        return json.dumps(_as_json(blueprint, found, other, bus))
    return "\n".join([*_table(blueprint, found, bus), *_remarks(blueprint, found, other, bus)])


def _table(blueprint: Blueprint, found: Forecast, bus: Bus) -> list[str]:
    groups: dict[str, list[Flow]] = {}
    for flow in found.flows:
        groups.setdefault(flow.group, []).append(flow)
    width = max(map(len, groups))
    lines = [
        f"{blueprint.robot.name} with {amount(len(blueprint.slots), 'part')} on {bus.words()}, "
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


def _as_json(blueprint: Blueprint, found: Forecast, other: Forecast, bus: Bus) -> dict[str, object]:
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
        "assumed_bytes": dict(found.assumed),
        "not_counted": list(found.on_event),
    }
