"""Simulated buses as people write them: `sim:classroom`, `sim:classroom?bitrate=250000&fd=1`.

What follows `sim:` is the name of a bus that any program of this user can join; options set up the bus for the program
that serves it (the master, if none does yet); for others they say what the bus must be.
"""

from __future__ import annotations

from typing import Final

from msbot_agent.link.can.adapters.can_driver import CanDriver
from msbot_agent.link.can.can_address import CanSettings, flag, native_link, rate
from msbot_agent.link.can.protocol.ids import CanIds
from msbot_agent.link.can.sim.sim_bus_client import SimAdapter, SimBusRequest, WhenAbsent
from msbot_agent.link.contract import Link
from msbot_xrce.errors import ConfigError

SIM_EXAMPLE: Final = "sim:classroom"

_OPTIONS: Final = ("bitrate", "dbitrate", "fd")


def open_sim(rest: str, serve: bool, settings: CanSettings) -> Link:
    """The native CAN link on a simulated bus; a master serves the bus if no program does, a part waits for it.

    Raises:
        ConfigError: the address makes no sense.
    """
    name, _, query = rest.partition("?")
    items = query.split("&")
    ours = dict([item.split("=", 1) for item in items if item.startswith("compression=")])
    codec = settings.codec if flag(ours, "compression", default=True) else None
    wish = parse_sim(f"{name}?{'&'.join(item for item in items if not item.startswith('compression='))}")
    node = "master" if serve or settings.uid is None else f"part {settings.uid[:4].hex()}"
    adapter = SimAdapter(wish, node=node, absent=WhenAbsent.SERVE if serve else WhenAbsent.WAIT)
    return native_link(CanDriver(adapter), serve, settings, codec, CanIds())


def open_sim_bus(rest: str, *, node: str, listen_only: bool) -> CanDriver:
    """A controller on a simulated bus that is being served, for tools that work with frames.

    Args:
        rest: what follows `sim:`.
        node: what the controller is called, for people who watch the bus.
        listen_only: neither send nor acknowledge.

    Raises:
        ConfigError: the address makes no sense.
    """
    return CanDriver(SimAdapter(parse_sim(rest), node=node, listen_only=listen_only))


def parse_sim(rest: str) -> SimBusRequest:
    """What follows the scheme; whether it names a bus is seen by `SimAdapter`.

    Raises:
        ConfigError: an option makes no sense.
    """
    name, _, query = rest.partition("?")
    options: dict[str, str] = {}
    for item in filter(None, query.split("&")):
        option, _, value = item.partition("=")
        if option not in _OPTIONS:
            raise ConfigError(f"there is no option {option!r}; there are {', '.join(_OPTIONS)}, compression")
        options[option] = value
    fd = flag(options, "fd", default=False) if "fd" in options else None
    data_bitrate = rate(options, "dbitrate", 8_000_000)
    if data_bitrate is not None and not fd:
        raise ConfigError("dbitrate is a rate of CAN FD: add fd=1")
    return SimBusRequest(name, rate(options, "bitrate", 1_000_000), data_bitrate, fd)
