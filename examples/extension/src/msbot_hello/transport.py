"""A kind of link, `slow:MS:ADDRESS`, and a data space, `scratch`."""

from contextlib import nullcontext
from random import Random

from msbot.errors import ConfigError
from msbot_agent.link import Disturbance, DisturbedLink, Link, Scheme, open_link
from msbot_agent.space import MemorySpace, SpaceKind


def open_slow(rest: str, serve: bool, can: object) -> Link:
    """Any other link whose packets take so many milliseconds longer."""
    ms, _, address = rest.partition(":")
    if not ms.isdigit():
        raise ConfigError(f"{ms!r} are no milliseconds")
    link = DisturbedLink(open_link(address, serve=serve))
    link.add(Disturbance(Random(0), delay=int(ms) / 1000))
    return link


def check(rest: str) -> None:
    """A scratch space has no options."""
    if rest:
        raise ConfigError("scratch has no options")


SLOW = Scheme("slow:50:udp:127.0.0.1:8888", open_slow)
SCRATCH = SpaceKind("scratch", check, lambda rest, partition, names: nullcontext(MemorySpace()))
