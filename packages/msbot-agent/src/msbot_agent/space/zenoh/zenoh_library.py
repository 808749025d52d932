"""Finds the library eclipse-zenoh, and says how its sessions are set up.

No session scouts: nothing is sent to anybody whom the user has not named, and without a named address nothing leaves
this computer. A put never waits: when a connection is congested the sample is dropped, and a reliable reader asks for
it again.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from types import ModuleType
from typing import TYPE_CHECKING, Any

from msbot_agent.space.network_options import TlsFiles
from msbot_xrce.errors import ConfigError

if TYPE_CHECKING:
    import zenoh

MISSING = "Zenoh needs the library eclipse-zenoh, and it is not here: pip install 'msbot-agent[zenoh]'"

RETRY = {"period_init_ms": 500, "period_max_ms": 2000, "period_increase_factor": 2}
"""How often a lost connection is tried again."""
LEASE_MS = 5000
"""A peer that is silent for so long is gone; it says something four times in that time."""
REPLY_MS = 3000
"""How long a reader waits for what writers have kept or repeat; one that has just gone does not answer."""
QUEUE = {"data": 16}
"""Batches of 64 KiB that may wait for a connection, 16 at most."""


def load() -> ModuleType:
    """The library.

    Raises:
        ConfigError: it is not here, or too old; the text says what to do.
    """
    try:
        import zenoh
        import zenoh.ext
    except ImportError:
        raise ConfigError(MISSING) from None
    if not hasattr(zenoh.ext, "declare_advanced_publisher"):
        raise ConfigError("this version of eclipse-zenoh cannot repeat lost samples: pip install 'eclipse-zenoh>=1.10'")
    found: ModuleType = zenoh
    return found


def session_config(
    mode: str,
    *,
    listen: Sequence[str] = (),
    connect: Sequence[str] = (),
    tls: TlsFiles | None = None,
    access: dict[str, Any] | None = None,
) -> zenoh.Config:
    """The library's configuration of a session.

    Args:
        mode: `client` or `router`.
        listen: endpoints to serve; if one cannot be, opening fails.
        connect: endpoints to connect to; a client uses the first that answers, a router all of them.
        tls: certificates for the endpoints with TLS.
        access: the library's access control.
    """
    link: dict[str, Any] = {
        "tx": {
            "lease": LEASE_MS,
            "queue": {
                "size": QUEUE,
                "congestion_control": {"drop": {"wait_before_drop": 0, "max_wait_before_drop_fragments": 0}},
            },
        }
    }
    if tls is not None:
        link["tls"] = _tls(mode, tls)
    connecting: dict[str, Any] = {"endpoints": list(connect), "retry": RETRY}
    if mode == "router":
        connecting |= {"timeout_ms": -1, "exit_on_failure": False}  # go on without, and keep trying
    config: dict[str, Any] = {
        "mode": mode,
        "scouting": {"multicast": {"enabled": False}, "gossip": {"enabled": False}},
        "timestamping": {"enabled": True},  # histories need it
        "queries_default_timeout": REPLY_MS,
        "listen": {"endpoints": list(listen)},
        "connect": connecting,
        "transport": {"shared_memory": {"enabled": False}, "link": link},
    }
    if access is not None:
        config["access_control"] = access
    made: zenoh.Config = load().Config.from_json5(json.dumps(config))
    return made


def _tls(mode: str, tls: TlsFiles) -> dict[str, Any]:
    found: dict[str, Any] = {"root_ca_certificate": str(tls.ca)}
    if tls.certificate is not None:
        found |= {"connect_certificate": str(tls.certificate), "connect_private_key": str(tls.key), "enable_mtls": True}
    if mode == "router":
        found |= {"listen_certificate": str(tls.certificate), "listen_private_key": str(tls.key)}
    return found
