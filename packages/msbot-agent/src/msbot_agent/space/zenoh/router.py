"""A router: what the sites of a wide network connect to, and who may send and receive what through it."""

from __future__ import annotations

import errno
import re
from collections.abc import Sequence
from typing import Any

from msbot_agent.space.network_options import TlsFiles
from msbot_agent.space.zenoh.key_expressions import GRAPH, ROOT
from msbot_agent.space.zenoh.router_connection import check_files
from msbot_agent.space.zenoh.zenoh_library import load, session_config
from msbot_xrce.errors import ConfigError
from msbot_xrce.lazy import dataclass

_DATA = ["put", "delete", "reply", "liveliness_token", "declare_queryable"]
"""What a sender says: samples, those that it repeats, and that it is there."""
_WISHES = ["declare_subscriber", "query", "liveliness_query", "declare_liveliness_subscriber"]
"""What a receiver says."""
_ADVANCED = "@adv"
"""Below the key of a topic, where the library numbers and repeats its samples."""
_ADDRESS_IN_USE = re.compile(rf"os error ({errno.EADDRINUSE}|{errno.EACCES}|{errno.EADDRNOTAVAIL})\b")


@dataclass(frozen=True, slots=True)
class Allowed:
    """Something that the router lets through."""

    who: tuple[str, ...] = ()
    """Common names of certificates; empty: everybody."""
    keys: tuple[str, ...] = ("**",)
    """Key expressions below `msbot/`."""
    sends: bool = True
    receives: bool = True


class Router:
    """Serves as long as it is open; can be used with `with`."""

    def __init__(
        self,
        listen: Sequence[str],
        connect: Sequence[str] = (),
        *,
        tls: TlsFiles | None = None,
        allowed: Sequence[Allowed] = (),
    ) -> None:
        """Serve.

        Args:
            listen: endpoints to serve.
            connect: other routers' endpoints; they may come later.
            tls: certificates, for endpoints with TLS; whoever connects must have one from the same `ca`.
            allowed: what passes; nothing else does, unless this is empty: then everything passes.

        Raises:
            ConfigError: an endpoint cannot be served, a certificate cannot be used, or the library is missing.
        """
        library = load()
        if tls is not None:
            check_files(tls)
        try:
            config = session_config("router", listen=listen, connect=connect, tls=tls, access=access_control(allowed))
            self._session = library.open(config)
        except library.ZError as error:
            raise ConfigError(_sentence(listen, str(error))) from None

    def __enter__(self) -> Router:
        return self

    def __exit__(self, *_: object) -> None:
        self._session.close()

    @property
    def sites(self) -> int:
        """Sessions and routers that are connected now."""
        return len(self._session.info.transports())


def access_control(allowed: Sequence[Allowed]) -> dict[str, Any] | None:
    """The library's access control for these rules; None: everything passes."""
    if not allowed:
        return None
    rules, subjects, policies = [], [], []
    for number, rule in enumerate(allowed):
        keys = [f"{ROOT}/{key}{below}" for key in rule.keys for below in ("", f"/{_ADVANCED}/**", f"/{GRAPH}/**")]
        ways = []
        for wanted, ingress, egress in ((rule.sends, _DATA, _WISHES), (rule.receives, _WISHES, _DATA)):
            if wanted:
                ways += [("ingress", ingress), ("egress", egress)]
        names = []
        for position, (flow, messages) in enumerate(ways):
            names.append(f"rule {number}.{position}")
            rules.append(
                {"id": names[-1], "permission": "allow", "flows": [flow], "messages": messages, "key_exprs": keys}
            )
        subject: dict[str, Any] = {"id": f"who {number}"}
        if rule.who:
            subject["cert_common_names"] = list(rule.who)
        subjects.append(subject)
        policies.append({"rules": names, "subjects": [subject["id"]]})
    return {
        "enabled": True,
        "default_permission": "deny",
        "rules": rules,
        "subjects": subjects,
        "policies": policies,
    }


def _sentence(listen: Sequence[str], error: str) -> str:
    where = ", ".join(listen)
    known = _ADDRESS_IN_USE.search(error)
    if known is None:
        return f"the router cannot serve {where}: {error.partition(' at /')[0]}"
    endpoint = next((one for one in listen if one.rpartition(":")[0] in error), where)
    port = endpoint.rpartition(":")[2]
    match int(known[1]):
        case errno.EADDRINUSE:
            return f"the router cannot serve {endpoint}: port {port} is taken; does another router run already?"
        case errno.EACCES:
            return f"the router cannot serve {endpoint}: port {port} needs more rights; take one above 1023"
        case _:
            return f"the router cannot serve {endpoint}: this computer does not have that address"
