"""The world of Jacdac: modules behind a browser's USB, or behind Jacdac's own tools."""

from __future__ import annotations

from collections.abc import Sequence

from msbot_bridges.bridge import BridgeLink, Fit, World, WorldKind
from msbot_xrce.errors import ConfigError


def open_world(link: BridgeLink) -> World:
    """Make a world; the library is loaded here.

    Raises:
        ConfigError: the library is missing, or the address makes no sense.
    """
    try:
        from msbot_bridges.jacdac.jacdac_world import JacdacWorld
    except ModuleNotFoundError as error:
        raise ConfigError(f"Jacdac takes the library {error.name}: pip install 'msbot-bridges[jacdac]'") from error
    if link.address.startswith(("ws://", "wss://")):
        return JacdacWorld(link.address, "127.0.0.1", 0)
    kind, _, port = link.address.partition(":")
    if kind != "page" or not port.isdecimal() or int(port) > 65535:
        raise ConfigError(
            f"--link {link.address}: write page:PORT for a page with USB, for example page:8082, or "
            "ws://127.0.0.1:8081 for Jacdac's own tools"
        )
    return JacdacWorld("", "127.0.0.1", int(port))


def _fits() -> Sequence[Fit]:
    from msbot_bridges.jacdac.services import service_fits

    return service_fits()


WORLD = WorldKind("Jacdac modules, by USB through a browser", "page:8082", open_world, fits=_fits)
