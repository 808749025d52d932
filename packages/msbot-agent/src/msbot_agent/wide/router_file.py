"""Reads `router.toml`: what a router serves, and who may send and receive what."""

from __future__ import annotations

import re
from pathlib import Path

from msbot_agent.space import TlsFiles, check_endpoint
from msbot_agent.space.zenoh import Allowed
from msbot_agent.toml.document import read_document
from msbot_agent.toml.problems import Problems
from msbot_agent.toml.table import Table
from msbot_xrce.errors import ConfigError
from msbot_xrce.lazy import dataclass

HERE = "tcp/127.0.0.1:7447"
"""What a router without a file serves: this computer only."""
SENDS, RECEIVES = "send", "receive"
_KEY = re.compile(r"(?:\*\*|\*|[^/*?#$@\s]+)(?:/(?:\*\*|\*|[^/*?#$@\s]+))*")


@dataclass(frozen=True, slots=True)
class RouterRules:
    """A whole file."""

    listen: tuple[str, ...] = (HERE,)
    connect: tuple[str, ...] = ()
    tls: TlsFiles | None = None
    allowed: tuple[Allowed, ...] = ()


def read_router_file(path: Path) -> RouterRules:
    """Read the file; names of certificates in it are seen from its folder.

    Raises:
        ConfigError: it cannot be read, or is wrong; the text names every problem with line and remedy.
    """
    problems = Problems()
    document = read_document(path, problems, if_missing="write it as `msbot help zenoh` shows")
    problems.raise_if_any()
    assert document is not None
    root = Table(document, problems, document.values)
    listen = _endpoints(root, "listen") or ([] if "listen" in root else [HERE])
    if not listen:
        root.report(f'must name at least one endpoint, for example "{HERE}"', "listen")
    connect = _endpoints(root, "connect")
    tls = _tls(root.table("tls"), path.parent)
    for key, endpoints in (("listen", listen), ("connect", connect)):
        for position, endpoint in enumerate(endpoints):
            if endpoint.startswith("tls/") and tls is None:
                root.report(f"{endpoint} needs certificates: add a table that begins with [tls]", key, position)
    allowed = [_allowed(table, has_tls=tls is not None) for table in root.tables("allow")]
    root.finish()
    problems.raise_if_any()
    return RouterRules(tuple(listen), tuple(connect), tls, tuple(allowed))


def _endpoints(root: Table, key: str) -> list[str]:
    found = root.names(key, HERE)
    for position, endpoint in enumerate(found):
        if endpoint:
            try:
                check_endpoint(endpoint)
            except ConfigError as error:
                root.report(str(error), key, position)
    return found


def _tls(table: Table, folder: Path) -> TlsFiles | None:
    if not table.is_there:
        return None
    ca, certificate, key = (
        table.name(name, f"{example}")
        for name, example in (("ca", "ca.pem"), ("certificate", "router.pem"), ("key", "router.key"))
    )
    table.finish()
    return TlsFiles(folder / ca, folder / certificate, folder / key)


def _allowed(table: Table, *, has_tls: bool) -> Allowed:
    who = table.names("who", "north")
    if who and not has_tls:
        table.report("who somebody is, only a certificate tells: add a table that begins with [tls]", "who")
    keys = table.names("keys", "ROVER/**") or ["**"]
    for position, key in enumerate(keys):
        if key and not _KEY.fullmatch(key):
            table.report(
                f'"{key}" is no key: words with / between them, * for one of them and ** for any number, '
                'for example "ROVER/**"',
                "keys",
                position,
            )
    may = table.names("may", SENDS) or [SENDS, RECEIVES]
    for position, word in enumerate(may):
        if word and word not in (SENDS, RECEIVES):
            table.report(f'"{word}" is neither "{SENDS}" nor "{RECEIVES}"', "may", position)
    table.finish()
    return Allowed(tuple(who), tuple(keys), SENDS in may, RECEIVES in may)
