"""Which data space a user means: `memory`, `dds`, `dds:5`, `dds:5?interface=eth0`."""

from __future__ import annotations

import contextlib
import re
from contextlib import AbstractContextManager
from dataclasses import dataclass

from msbot.errors import ConfigError
from msbot.space.contract import Space
from msbot.space.dds_topics import DdsTopicsOf, as_it_is
from msbot.space.memory import MemorySpace

MEMORY = "memory"
DDS = "dds"

MAX_DOMAIN = 232
"""DDS domains above this have no UDP ports (DDSI-RTPS 2.3 §9.6.1.1)."""

_FORM = re.compile(r"(?P<kind>[a-z]+)(:(?P<domain>[^?]*))?(\?(?P<options>.*))?")


@dataclass(frozen=True, slots=True)
class SpaceAddress:
    """A data space that a user asked for."""

    kind: str = MEMORY
    domain: int = 0
    interface: str | None = None
    """The only network interface to use; None: the network there is."""


def parse_space(text: str) -> SpaceAddress:
    """What the user wrote.

    Raises:
        ConfigError: it names no data space; the text says what would be right.
    """
    match = _FORM.fullmatch(text)
    kind = match["kind"] if match else ""
    if match is None or kind not in (MEMORY, DDS) or (kind == MEMORY and text != MEMORY):
        raise ConfigError(f"{text!r} is not a data space: memory, dds, or dds:DOMAIN is needed, for example dds:5")
    options = dict(option.partition("=")[::2] for option in (match["options"] or "").split("&") if option)
    interface = options.pop("interface", None)
    if options or interface == "":
        raise ConfigError(f"{text!r}: dds has one option, interface, for example dds:5?interface=eth0")
    return SpaceAddress(kind, _domain(text, match["domain"]), interface)


def open_space(
    address: SpaceAddress, *, partition: str = "", dds_topics_of: DdsTopicsOf = as_it_is
) -> AbstractContextManager[Space]:  # fmt: skip
    """Open the space, for use with `with` on a running event loop.

    Args:
        address: which.
        partition: in DDS, the partition of endpoints that name none themselves.
        dds_topics_of: in DDS, the names of a topic; verbatim if absent.

    Raises:
        ConfigError: it is not available here; the text says what to do.
    """
    if address.kind == MEMORY:
        return contextlib.nullcontext(MemorySpace())
    from msbot.space.dds import DdsSpace

    return DdsSpace(address.domain, partition=partition, dds_topics_of=dds_topics_of, interface=address.interface)


def _domain(text: str, domain: str | None) -> int:
    if domain is None:
        return 0
    if not (domain.isascii() and domain.isdigit() and len(domain) < 6):
        raise ConfigError(f"{text!r}: the domain is a number from 0 to {MAX_DOMAIN}")
    if int(domain) > MAX_DOMAIN:
        raise ConfigError(f"{text!r}: DDS domains go from 0 to {MAX_DOMAIN}, those above have no UDP ports")
    return int(domain)
