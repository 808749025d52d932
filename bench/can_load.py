"""How busy a bus is with parts at rest, and how many parts fit: the forecast of `msbot bus load`."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from bench.buses import BUSES, SIZES, Rates, table
from bench.can_costs import MESSAGES, frames_of
from bench.crowd import Outcome, ring
from msbot.config import load_library
from msbot.pnp import Forecast, forecast
from msbot_agent.link.can.protocol import Framing
from msbot_xrce import compress

FULL = 0.5
"""The load that a bus is filled to."""
NODES = 120
"""Addresses on a bus."""
RATES_HZ = (0, 10, 100)
"""Samples of 4 bytes that each part sends, and as many that it gets."""


def foresee(rates: Rates, size: int, folder: Path, *, compression: bool = True) -> float:
    """The foreseen load of so many parts that only beat."""
    framing = Framing(rates.fd, rates.fd, compress if compression else None)
    return forecast(ring(folder, size, bound=False), load_library(), framing).load(rates.nominal, rates.data)


def rest_table(measured: Mapping[tuple[Rates, int], Outcome], folder: Path) -> list[str]:
    """Load at rest, foreseen and measured."""
    rows = []
    for rates in BUSES:
        row = [rates.name]
        for size in SIZES:
            row.append(f"{foresee(rates, size, folder):.2%} / {measured[rates, size].load:.2%}")
        rows.append([*row, f"{foresee(rates, SIZES[-1], folder, compression=False):.1%}"])
    return table(["bus", *(f"{size}" for size in SIZES), "120 without compression"], rows)


def room_table(folder: Path) -> list[str]:
    """How many parts fit a bus at 50 % load."""
    rows = []
    for rates in BUSES:
        empty = forecast(ring(folder, 1, bound=False), load_library(), Framing(rates.fd, rates.fd, compress))
        beacon = Forecast(empty.flows[:1], {}, ()).load(rates.nominal, rates.data)
        beats = foresee(rates, 1, folder) - beacon
        mode = "FD, compressed" if rates.fd else "classic, compressed"
        sample = rates.seconds(frames_of([*MESSAGES[1][1], *MESSAGES[2][1]], mode))
        fits = [int((FULL - beacon) / (beats + hz * sample)) for hz in RATES_HZ]
        rows.append([rates.name, *(str(fit) if fit <= NODES else f"{NODES} (time for {fit})" for fit in fits)])
    return table(["bus", "beats only", *(f"and {hz} samples/s out and in" for hz in RATES_HZ[1:])], rows)
