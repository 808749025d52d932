"""The world of MQTT: a broker, and the conventions by which its devices are found."""

from __future__ import annotations

from collections.abc import AsyncIterator, Mapping, Sequence
from contextlib import asynccontextmanager
from typing import TYPE_CHECKING, Any

from msbot_bridges.bridge import BridgeLink, Fit, SimulatedDevice, World, WorldKind
from msbot_xrce.errors import ConfigError

if TYPE_CHECKING:
    from msbot_bridges.mqtt.mqtt_world import Convention


def open_world(link: BridgeLink) -> World:
    """Make a world; the library is loaded here.

    Raises:
        ConfigError: the library is missing, or address or options make no sense.
    """
    try:
        from msbot_bridges.mqtt.broker import read_address
        from msbot_bridges.mqtt.mqtt_world import MqttWorld
    except ModuleNotFoundError as error:
        raise ConfigError(f"MQTT takes the library {error.name}: pip install 'msbot-bridges[mqtt]'") from error
    from msbot_bridges.mqtt.ha_discovery import HaDiscovery
    from msbot_bridges.mqtt.homie4 import Homie4
    from msbot_bridges.mqtt.homie5 import Homie5
    from msbot_bridges.mqtt.homie_property import SETTING_NODES

    address = read_address(link.address, link.options)
    conventions: list[Convention] = []
    if prefix := _level(link, "discovery", "homeassistant"):
        conventions.append(HaDiscovery(prefix))
    if domain := _level(link, "homie", "homie"):
        nodes = [one.strip() for one in link.option("homie_settings", ",".join(SETTING_NODES)).split(",")]
        conventions += [Homie5(domain, nodes), Homie4(domain, nodes)]
    if not conventions:
        raise ConfigError("--option discovery= and --option homie=: with neither of them nothing is found")
    return MqttWorld(address, tuple(conventions))


def _level(link: BridgeLink, option: str, otherwise: str) -> str:
    """The first level of the topics of a convention; empty: it is not used."""
    text = link.option(option, otherwise).strip("/")
    if any(sign in text for sign in "+#"):
        raise ConfigError(f"--option {option}={text}: write the beginning of a topic, without + and #")
    return text


def _simulated_lamp(link: BridgeLink, options: Mapping[str, Any]) -> SimulatedDevice:
    from msbot_bridges.mqtt.simulated import SimulatedLamp

    return SimulatedLamp(link, options)


@asynccontextmanager
async def _network(link: BridgeLink) -> AsyncIterator[BridgeLink]:
    """See `WorldKind.network`: a broker, where the address is `broker:PORT`."""
    from msbot_bridges.mqtt.broker import own_port

    port = own_port(link.address)
    if port is None:
        yield link
        return
    from msbot_bridges.mqtt.own_broker.server import OwnBroker

    async with OwnBroker(port).running() as broker:
        yield BridgeLink(f"mqtt://127.0.0.1:{broker.port}", link.options)


def _fits() -> Sequence[Fit]:
    from msbot_bridges.mqtt.mqtt_fits import mqtt_fits

    return mqtt_fits()


WORLD = WorldKind(
    "MQTT: devices of Home Assistant's discovery (ESPHome, Tasmota, Zigbee2MQTT) and of Homie 4 and 5",
    "mqtt://127.0.0.1",
    open_world,
    {
        "discovery": "the discovery prefix of Home Assistant; homeassistant if left out, empty: without",
        "homie": "the first level of Homie's topics; homie if left out, empty: without",
        "homie_settings": "nodes of Homie devices whose properties are settings; settings,config if left out",
        "password_file": "a file with the password",
        "ca": "a file with the certificates to trust, for mqtts://",
    },
    {"lamp": _simulated_lamp},
    _fits,
    numbers={"lamp": "simulated:lamp"},
    network=_network,
)
