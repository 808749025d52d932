"""The bridges that a blueprint names, beside its master: started by whoever brings them, not known here."""

from __future__ import annotations

from collections.abc import Callable, Coroutine, Sequence
from typing import Protocol, runtime_checkable

from msbot.config import Blueprint, BridgeTable
from msbot.master import Master
from msbot.part import Part
from msbot_agent.link import InprocHub, Link
from msbot_agent.startup.extensions import extensions
from msbot_agent.text.sentence import said
from msbot_xrce.errors import ConfigError
from msbot_xrce.lazy import dataclass

GROUP = "bridge_runners"


@dataclass(frozen=True, slots=True)
class BridgeBus:
    """A CAN bus on which bridges have devices, and an estimate of what is sent there."""

    address: str
    worlds: tuple[str, ...]
    devices: int
    """So many are reckoned with: those that the blueprint simulates, or else one for each bridge."""
    frames_per_s: float
    bits_per_s: float
    bitrate: int | None
    """None: the address does not say."""
    is_shared: bool = False
    """The robot's own parts are on it, too."""


class PluggableDevice(Protocol):
    """A simulated device of a bridge, which can be pulled out and plugged in again; at first it is plugged in."""

    @property
    def name(self) -> str:
        """What it is, as its world calls it: `drive`."""

    @property
    def part_number(self) -> str:
        """What it will be in the robot; empty: it is not known beforehand."""

    @property
    def is_plugged(self) -> bool:
        """Whether it is there."""

    def plug(self) -> bool:
        """Plug it in; False: it already is."""

    def unplug(self) -> bool:
        """Pull it out, without a goodbye; False: it is out."""


@runtime_checkable
class BridgeRunner(Protocol):
    """Runs bridges; brought by the distribution that has them."""

    def check(self, bridges: Sequence[BridgeTable], links: Sequence[str] = ()) -> None:
        """Refuse what makes no sense, and what cannot be on one bus with each other or with the robot's own parts.

        Args:
            bridges: all of the blueprint.
            links: where the robot's own parts come in.

        Raises:
            ConfigError: the text says what would be right.
        """

    def buses(self, bridges: Sequence[BridgeTable], links: Sequence[str] = ()) -> Sequence[BridgeBus]:
        """The CAN buses of these bridges; `links` is where the robot's own parts come in."""

    def devices(self, bridges: Sequence[BridgeTable]) -> Sequence[PluggableDevice]:
        """The simulated devices of these bridges, for `coroutines`; in an event loop."""

    def coroutines(
        self,
        bridges: Sequence[BridgeTable],
        connect: Callable[[Part], Link],
        say: Callable[[str], None],
        devices: Sequence[PluggableDevice] | None = None,
    ) -> list[Coroutine[object, object, None]]:
        """What runs beside the master, until cancelled; the parts reach it by the links that `connect` makes.

        Args:
            bridges: all of the blueprint.
            connect: makes a link to the master for a part.
            say: takes what a person should know.
            devices: the simulated devices, where somebody wants to pull them out; made here if absent.
        """


def check_bridges(blueprint: Blueprint, links: Sequence[str] = ()) -> None:
    """Refuse bridges that cannot run; called before anything is opened.

    Args:
        blueprint: names them.
        links: where the robot's own parts come in.

    Raises:
        ConfigError: the text says what would be right.
    """
    if blueprint.bridges:
        _runner().check(blueprint.bridges, links)


def bridge_buses(blueprint: Blueprint, links: Sequence[str] = ()) -> Sequence[BridgeBus]:
    """The CAN buses on which the bridges of a blueprint have devices.

    Args:
        blueprint: names them.
        links: where the robot's own parts come in.

    Raises:
        ConfigError: a bridge cannot run; the text says what would be right.
    """
    return _runner().buses(blueprint.bridges, links) if blueprint.bridges else ()


def simulated_devices(blueprint: Blueprint) -> Sequence[PluggableDevice]:
    """The simulated devices of a blueprint's bridges, for `bridges_beside`."""
    return _runner().devices(blueprint.bridges) if blueprint.bridges else ()


def bridges_beside(
    blueprint: Blueprint,
    master: Master,
    say: Callable[[str], None],
    devices: Sequence[PluggableDevice] | None = None,
) -> list[Coroutine[object, object, None]]:
    """What runs the bridges of a blueprint beside its master; nothing when it names none."""
    if not blueprint.bridges:
        return []
    hub = InprocHub()
    master.add_link(hub.server)
    return _runner().coroutines(blueprint.bridges, lambda _: hub.connect(), say, devices)


def _runner() -> BridgeRunner:
    found = extensions().all(GROUP, object).values()
    for one in found:
        if isinstance(one, BridgeRunner):
            return one
    raise ConfigError(said("the blueprint has [[bridge]], which takes msbot-bridges: pip install 'msbot[bridges]'"))
