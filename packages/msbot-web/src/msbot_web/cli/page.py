"""The web page beside a running robot, as `msbot master` and `msbot demo` offer it."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

import click

from msbot_agent.cli.numbers import WholeRange
from msbot_xrce.common.lazy_dataclass import dataclass
from msbot_xrce.errors import ConfigError

if TYPE_CHECKING:
    from msbot_web.assembly import WebRoom
    from msbot_web.server import WebSettings

DEFAULT_PORT = 8080

_C = TypeVar("_C", bound=Callable[..., object])


@dataclass(frozen=True, slots=True)
class PageWishes:
    """The user's options."""

    host: str
    port: int
    or_any_port: bool
    """Take any free port if no specific one was requested and the usual one is taken."""
    off: bool
    certificate: Path | None
    key: Path | None
    names: tuple[str, ...] = ()
    proxies: tuple[str, ...] = ()

    def settings(self) -> WebSettings:
        """The same in the form that the web room takes; imports that room."""
        from msbot_web.server import WebSettings

        return WebSettings(self.host, self.port, self.or_any_port, self.certificate, self.key, self.names, self.proxies)


def page_options(command: _C) -> _C:
    """Add the options of the page to a command; `page_wishes` reads them."""
    path = click.Path(path_type=Path, dir_okay=False, exists=True)
    for option in (
        click.option("--certificate-key", type=path, help="The certificate's private key (PEM file), if apart."),
        click.option("--certificate", type=path, help="Serve the page by TLS with this certificate (PEM)."),
        click.option("--page-name", "page_names", multiple=True, metavar="NAME",
                     help="Another host name by which browsers ask for the page; the computer's own always will do."),
        click.option("--trusted-proxy", "trusted_proxies", multiple=True, metavar="ADDRESS",
                     help="A reverse proxy (or a network of them) whose X-Forwarded- headers count for the page."),
        click.option("--no-page", is_flag=True, help="Serve no web page."),
        click.option("--host", default="127.0.0.1", show_default=True,
                     help="Where the page is served: 127.0.0.1 is this computer only, 0.0.0.0 every network it is in."),
        click.option("--port", type=WholeRange(0, 65535),
                     help=f"Port of the page: {DEFAULT_PORT}, or the next free one; 0 = any free one."),
    ):  # fmt: skip
        command = option(command)
    return command


def page_wishes(
    *,
    port: int | None,
    host: str,
    no_page: bool,
    certificate: Path | None,
    certificate_key: Path | None,
    page_names: tuple[str, ...] = (),
    trusted_proxies: tuple[str, ...] = (),
) -> PageWishes:
    """The options as one value.

    Raises:
        ConfigError: a key without a certificate.
    """
    if certificate_key is not None and certificate is None:
        raise ConfigError("--certificate-key needs the certificate, too: --certificate FILE")
    return PageWishes(
        host,
        DEFAULT_PORT if port is None else port,
        port is None,
        off=no_page,
        certificate=certificate,
        key=certificate_key,
        names=page_names,
        proxies=trusted_proxies,
    )


async def serve_page(
    room: WebRoom, ready: asyncio.Event | None, wishes: PageWishes, say: Callable[[str], None]
) -> None:
    """Serve the page until cancelled; say where it is as soon as it and the robot are up.

    Args:
        room: the page. It is made before the robot runs, because no beats are sent during that time.
        ready: set when the robot is up; None: a visitor may see the robot while it comes up.
        wishes: the options.
        say: takes the lines for the person at the terminal.
    """
    async with asyncio.TaskGroup() as tasks:
        serving = tasks.create_task(room.run())
        await room.server.ready.wait()
        if ready is not None:
            await ready.wait()
        say(f"The page is at {room.server.link}")
        if wishes.host not in ("127.0.0.1", "localhost", "::1"):
            say("Everybody in this computer's networks can reach it; a password protects it"
                + ("." if wishes.certificate else ", but what travels can be read: add --certificate."))  # fmt: skip
        await serving
