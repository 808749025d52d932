"""`--announce`: a master that says in the network that it is there."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from msbot_school.classroom import mdns
from msbot_web.cli.page import PageWishes
from msbot_xrce.errors import ConfigError

if TYPE_CHECKING:
    from msbot.master import Master
    from msbot_web.assembly import WebRoom

ONLY_HERE = ("127.0.0.1", "localhost", "::1")
ALL_NETWORKS = ("0.0.0.0", "::")


def class_to_announce(name: str, page: PageWishes) -> str:
    """The class that a master is announced for.

    Raises:
        ConfigError: it cannot be announced like that; the text says what would be right.
    """
    if page.off or page.host in ONLY_HERE:
        raise ConfigError(
            "--announce needs a page that other computers can reach: --host 0.0.0.0, or this computer's address in "
            "one network"
        )
    own = mdns.own_addresses()
    if page.host not in ALL_NETWORKS and page.host not in own:
        known = f", or {', '.join(own)}" if own else ""
        raise ConfigError(
            f"--announce tells an IPv4 address of this computer, and {page.host} is none: --host 0.0.0.0{known}"
        )
    return mdns.check_class_name(name)


def announcer(
    master: Master, room: WebRoom, page: PageWishes, class_name: str, say: Callable[[str], None]
) -> mdns.Announcer:
    """What announces a master and its page."""
    profile = master.profile
    host = "" if page.host in ALL_NETWORKS else page.host
    announced = mdns.Announced(
        profile.name, profile.serial_number, profile.version, class_name, room.server.port,
        page.certificate is not None, host,
    )  # fmt: skip
    return mdns.Announcer(announced, say)
