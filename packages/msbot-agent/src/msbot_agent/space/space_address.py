"""Which data space a user means: `memory`, `dds`, `dds:5?interface=eth0`, `zenoh`, `zenoh:tls/host:7447?ca=ca.pem`."""

from __future__ import annotations

import contextlib
import re
from collections.abc import Callable
from contextlib import AbstractContextManager
from pathlib import Path

from msbot_agent.space.contract import Space
from msbot_agent.space.dds_topics import ROBOTS, DdsTopicsOf, as_it_is
from msbot_agent.space.memory import MemorySpace
from msbot_agent.space.network_options import MAX_DOMAIN, TlsFiles
from msbot_agent.startup.extensions import extensions
from msbot_xrce.errors import ConfigError
from msbot_xrce.lazy import dataclass

MEMORY = "memory"
DDS = "dds"
ZENOH = "zenoh"
KINDS = (MEMORY, DDS, ZENOH)


ZENOH_HERE = "tcp/127.0.0.1:7447"
"""The router that `zenoh` alone means, on this computer."""

_FORM = re.compile(r"(?P<kind>[a-z]+)(:(?P<domain>[^?]*))?(\?(?P<options>.*))?")
_ENDPOINT = re.compile(r"(?:tcp|tls)/(?:\[[0-9A-Fa-f:.%]+\]|[A-Za-z0-9._-]+):(?P<port>[0-9]{1,5})")
_TLS_OPTIONS = ("ca", "cert", "key")


@dataclass(frozen=True, slots=True)
class SpaceAddress:
    """A data space that a user asked for."""

    kind: str = MEMORY
    domain: int = 0
    interface: str | None = None
    """The only network interface to use; None: the network there is."""
    routers: tuple[str, ...] = ()
    """Zenoh: the router's endpoint, or several to choose from."""
    tls: TlsFiles | None = None
    """Zenoh: certificates for endpoints with TLS."""
    rest: str = ""
    """Of a kind that an extension brings: what follows its name."""


@dataclass(frozen=True, slots=True)
class SpaceKind:
    """A kind of data space that an extension brings."""

    example: str
    """An address that a person can copy."""
    check: Callable[[str], object]
    """`(what follows the name and its colon)`; raises ConfigError if it makes no sense."""
    open: Callable[[str, str, DdsTopicsOf], AbstractContextManager[Space]]
    """`(that, partition, names of a topic)`: opens it, for use with `with` on a running event loop."""


def brought_kinds() -> dict[str, SpaceKind]:
    """The kinds of data spaces that extensions bring, by name."""
    return extensions().all("spaces", SpaceKind, KINDS)


def parse_space(text: str, *, folder: Path = Path()) -> SpaceAddress:
    """What the user wrote; names of files are seen from `folder`.

    Raises:
        ConfigError: it names no data space; the text says what would be right.
    """
    match = _FORM.fullmatch(text)
    kind = match["kind"] if match else ""
    if kind not in KINDS and (brought := extensions().get("spaces", kind, SpaceKind)):
        rest = text.removeprefix(kind).removeprefix(":")
        try:
            brought.check(rest)
        except ConfigError as error:
            raise ConfigError(f"data space {text!r}: {error}; write it like `{brought.example}`") from error
        return SpaceAddress(kind, rest=rest)
    if match is None or kind not in KINDS or (kind == MEMORY and text != MEMORY):
        raise ConfigError(
            f"{text!r} is not a data space: memory, dds, dds:DOMAIN or zenoh:tcp/HOST:PORT is needed, for example dds:5"
        )
    options = dict(option.partition("=")[::2] for option in (match["options"] or "").split("&") if option)
    if kind == ZENOH:
        return _zenoh(text, match["domain"], options, folder)
    interface = options.pop("interface", None)
    if options or interface == "":
        raise ConfigError(f"{text!r}: dds has one option, interface, for example dds:5?interface=eth0")
    return SpaceAddress(kind, _domain(text, match["domain"]), interface)


def check_endpoint(endpoint: str, *, least_port: int = 1) -> None:
    """Check an endpoint of Zenoh.

    Raises:
        ConfigError: it is none; the text says what would be right.
    """
    match = _ENDPOINT.fullmatch(endpoint)
    if match is None:
        raise ConfigError(
            f"{endpoint!r} is no endpoint: tcp/HOST:PORT or tls/HOST:PORT is needed, for example {ZENOH_HERE}"
        )
    if not least_port <= int(match["port"]) <= 65535:
        raise ConfigError(f"{endpoint!r}: a port is a number from {least_port} to 65535")


def robot_partition(address: SpaceAddress, robot: str) -> str:
    """The partition of a robot's topics: its name, in DDS with a prefix."""
    return f"{ROBOTS}{robot}" if address.kind == DDS else robot


def open_space(
    address: SpaceAddress, *, partition: str = "", dds_topics_of: DdsTopicsOf = as_it_is
) -> AbstractContextManager[Space]:
    """Open the space, for use with `with` on a running event loop.

    Args:
        address: which.
        partition: in DDS and Zenoh, the partition of endpoints that name none themselves.
        dds_topics_of: in DDS and Zenoh, the names of a topic; verbatim if absent.

    Raises:
        ConfigError: it is not available here; the text says what to do.
    """
    if address.kind == MEMORY:
        return contextlib.nullcontext(MemorySpace())
    if address.kind == ZENOH:
        from msbot_agent.space.zenoh import ZenohSpace

        return ZenohSpace(address.routers, tls=address.tls, partition=partition, dds_topics_of=dds_topics_of)
    if address.kind != DDS:
        brought = extensions().get("spaces", address.kind, SpaceKind)
        if brought is None:
            raise ConfigError(f"the extension with the data space {address.kind!r} is left out: `msbot extensions`")
        return brought.open(address.rest, partition, dds_topics_of)
    from msbot_agent.space.dds import DdsSpace

    return DdsSpace(address.domain, partition=partition, dds_topics_of=dds_topics_of, interface=address.interface)


def _domain(text: str, domain: str | None) -> int:
    if domain is None:
        return 0
    if not (domain.isascii() and domain.isdigit() and len(domain) < 6):
        raise ConfigError(f"{text!r}: the domain is a number from 0 to {MAX_DOMAIN}")
    if int(domain) > MAX_DOMAIN:
        raise ConfigError(f"{text!r}: DDS domains go from 0 to {MAX_DOMAIN}, those above have no UDP ports")
    return int(domain)


def _zenoh(text: str, endpoints: str | None, options: dict[str, str], folder: Path) -> SpaceAddress:
    routers = tuple((endpoints if endpoints is not None else ZENOH_HERE).split(","))
    try:
        for endpoint in routers:
            check_endpoint(endpoint)
    except ConfigError as error:
        raise ConfigError(f"{text!r}: {error}") from None
    unknown = [name for name in options if name not in _TLS_OPTIONS]
    if unknown:
        raise ConfigError(f"{text!r}: zenoh has the options ca, cert and key, not {unknown[0]!r}")
    secure = any(endpoint.startswith("tls/") for endpoint in routers)
    if options and not secure:
        raise ConfigError(f"{text!r}: certificates are for endpoints that begin with tls/")
    if not secure:
        return SpaceAddress(ZENOH, routers=routers)
    if not options.get("ca"):
        raise ConfigError(f"{text!r}: tls needs the certificate of those to be accepted, for example ?ca=ca.pem")
    if bool(options.get("cert")) != bool(options.get("key")):
        raise ConfigError(f"{text!r}: cert and key belong together, for example ?ca=ca.pem&cert=me.pem&key=me.key")
    own = [folder / options[name] if options.get(name) else None for name in ("cert", "key")]
    return SpaceAddress(ZENOH, routers=routers, tls=TlsFiles(folder / options["ca"], *own))
