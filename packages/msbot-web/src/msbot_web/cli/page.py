"""The web page beside a running robot, as `msbot master` and `msbot demo` offer it."""

from __future__ import annotations

import asyncio
import importlib
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import click

from msbot_agent.cli.command_services import Beside, CommandService
from msbot_agent.cli.options import WholeRange
from msbot_agent.startup.bytecode_cache import without_garbage_collection
from msbot_school.classroom import mdns
from msbot_xrce.errors import ConfigError
from msbot_xrce.lazy import dataclass

if TYPE_CHECKING:
    from msbot.cli.run.master_services import MasterContext
    from msbot.master import Master
    from msbot_web.assembly import RobotPages
    from msbot_web.server import WebSettings


DEFAULT_PORT = 8080

_C = TypeVar("_C", bound=Callable[..., object])


@dataclass(frozen=True, slots=True)
class PageOptions:
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
    open_set_up: bool = False
    """Whoever opens the page first becomes its administrator."""

    def settings(self, place: str = "") -> WebSettings:
        """The same in the form that the web room takes; imports that room. `place` as in `WebSettings`."""
        from msbot_web.server import WebSettings

        return WebSettings(
            self.host,
            self.port,
            self.or_any_port,
            self.certificate,
            self.key,
            self.names,
            self.proxies,
            place,
            self.open_set_up,
        )


def page_options(command: _C) -> _C:
    """Add the options of the page to a command; `page_wishes` reads them."""
    path = click.Path(path_type=Path, dir_okay=False, exists=True)
    for option in (
        click.option(
            "--certificate-key", type=path, help="The certificate's private key (PEM), if in a file of its own."
        ),
        click.option("--certificate", type=path, help="Serve the page by TLS with this certificate (PEM)."),
        click.option(
            "--page-name",
            "page_names",
            multiple=True,
            metavar="NAME",
            help="Another host name of the page, besides the computer's own; repeatable.",
        ),
        click.option(
            "--trusted-proxy",
            "trusted_proxies",
            multiple=True,
            metavar="ADDRESS",
            help="A reverse proxy, or a network of them, whose X-Forwarded- headers count; repeatable.",
        ),
        click.option("--no-page", is_flag=True, help="Serve no web page."),
        click.option(
            "--host",
            default="127.0.0.1",
            show_default=True,
            help="Where the page is served: 127.0.0.1 is this computer only, 0.0.0.0 every network it is in.",
        ),
        click.option(
            "--port",
            type=WholeRange(0, 65535),
            help=f"Port of the page: {DEFAULT_PORT}, or the next free one; 0 = any free one.",
        ),
    ):
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
    open_set_up: bool = False,
) -> PageOptions:
    """The options as one value.

    Raises:
        ConfigError: a key without a certificate.
    """
    if certificate_key is not None and certificate is None:
        raise ConfigError("--certificate-key needs the certificate, too: --certificate FILE")
    return PageOptions(
        host,
        DEFAULT_PORT if port is None else port,
        port is None,
        off=no_page,
        certificate=certificate,
        key=certificate_key,
        names=page_names,
        proxies=trusted_proxies,
        open_set_up=open_set_up,
    )


async def serve_page(
    room: RobotPages, ready: asyncio.Event | None, wishes: PageOptions, say: Callable[[str], None]
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
            say(
                "Everybody in this computer's networks can reach it; a password protects it"
                + ("." if wishes.certificate else ", but what travels can be read: add --certificate.")
            )
        await serving


# `--announce`: a master that says in the network that it is there.


ONLY_HERE = ("127.0.0.1", "localhost", "::1")
ALL_NETWORKS = ("0.0.0.0", "::")


def class_to_announce(name: str, page: PageOptions) -> str:
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
    master: Master, room: RobotPages, page: PageOptions, class_name: str, say: Callable[[str], None]
) -> mdns.MasterAnnouncer:
    """What announces a master and its page."""
    profile = master.profile
    host = "" if page.host in ALL_NETWORKS else page.host
    announced = mdns.MasterAnnouncement(
        profile.name,
        profile.serial_number,
        profile.version,
        class_name,
        room.server.port,
        page.certificate is not None,
        host,
    )
    return mdns.MasterAnnouncer(announced, say)


# The service `page` of `msbot master`: the robot's web page, and with `--announce` its name in the network.


announce_option = click.option(
    "--announce",
    metavar="CLASS",
    help="Announce this robot on the network, for `msbot class find`; needs --host.",
)


open_set_up_option = click.option(
    "--open-set-up",
    is_flag=True,
    help="Let whoever opens the page first become its administrator, without the link: for a robot without a screen.",
)


@dataclass(frozen=True, slots=True)
class _Wanted:
    page: PageOptions
    announced_for: str
    """The class for which it is announced in the network; empty: it is not."""


class PageService(CommandService[_Wanted, "MasterContext"]):
    """Shows the lessons of the service `teaching`."""

    options = (page_options, announce_option, open_set_up_option)
    after = ("teaching",)

    def check(self, given: Mapping[str, Any]) -> _Wanted | None:
        """The page's options."""
        page = page_wishes(
            port=given["port"],
            host=given["host"],
            no_page=given["no_page"],
            certificate=given["certificate"],
            certificate_key=given["certificate_key"],
            page_names=given["page_names"],
            trusted_proxies=given["trusted_proxies"],
            open_set_up=given["open_set_up"],
        )
        announced_for = ""
        if given["announce"] is not None:
            announced_for = class_to_announce(given["announce"], page)
        return None if page.off else _Wanted(page, announced_for)

    def preload(self, wanted: _Wanted) -> None:  # noqa: ARG002 - every page is the same to load
        """Load the page."""
        with without_garbage_collection():
            importlib.import_module("msbot_web.assembly")

    def coroutines(self, wanted: _Wanted, context: MasterContext) -> Iterable[Beside]:
        """The page, and what announces it."""
        with without_garbage_collection():
            from msbot_school.lessons.lesson_controller import LessonController
            from msbot_web.assembly import Database, RobotPages
            from msbot_web.link_meter import seen_of_links

            desk = context.offers.get("teaching")
            room = RobotPages(
                context.master,
                context.operations,
                context.library,
                database=Database(context.registry, context.robot, context.db),
                seen=seen_of_links(context.links),
                settings=wanted.page.settings(),
                lessons=desk if isinstance(desk, LessonController) else None,
                space=context.space,
            )
        context.page_address = lambda: room.server.own_address
        context.page_figures = room.figures
        found = [serve_page(room, context.ready, wanted.page, context.say)]
        if wanted.announced_for:
            found.append(announcer(context.master, room, wanted.page, wanted.announced_for, context.say).run())
        return found


PAGE = PageService()
