"""The service `page` of `msbot master`: the robot's web page, and with `--announce` its name in the network."""

from __future__ import annotations

import importlib
from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any

import click

from msbot_agent.cli.services import Beside, CommandService
from msbot_agent.startup.made_to_stay import made_to_stay
from msbot_web.cli.page import PageWishes, page_options, page_wishes, serve_page
from msbot_xrce.common.lazy_dataclass import dataclass

if TYPE_CHECKING:
    from msbot.cli.run.master_context import MasterContext

announce_option = click.option(
    "--announce", metavar="CLASS", help="Say in the network that this robot is there, for `msbot class find`; needs a "
    "page that others can reach: --host.",
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class _Wanted:
    page: PageWishes
    announced_for: str
    """The class for which it is announced in the network; empty: it is not."""


class PageService(CommandService[_Wanted, "MasterContext"]):
    """Shows the lessons of the service `teaching`."""

    options = (page_options, announce_option)
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
        )
        announced_for = ""
        if given["announce"] is not None:
            from msbot_web.cli.announce import class_to_announce

            announced_for = class_to_announce(given["announce"], page)
        return None if page.off else _Wanted(page, announced_for)

    def prepare(self, wanted: _Wanted) -> None:  # noqa: ARG002 - every page is the same to load
        """Load the page."""
        with made_to_stay():
            importlib.import_module("msbot_web.assembly")

    def beside(self, wanted: _Wanted, context: MasterContext) -> Iterable[Beside]:
        """The page, and what announces it."""
        with made_to_stay():
            from msbot_school.lessons.lesson_desk import LessonDesk
            from msbot_web.assembly import Database, WebRoom
            from msbot_web.real_buses import seen_of_links

            desk = context.offers.get("teaching")
            room = WebRoom(
                context.master,
                context.operations,
                context.library,
                database=Database(context.registry, context.robot, context.db),
                seen=seen_of_links(context.links),
                settings=wanted.page.settings(),
                lessons=desk if isinstance(desk, LessonDesk) else None,
                space=context.space,
            )
        context.page_address = lambda: room.server.own_address
        context.page_figures = room.figures
        found = [serve_page(room, context.ready, wanted.page, context.say)]
        if wanted.announced_for:
            from msbot_web.cli.announce import announcer

            found.append(announcer(context.master, room, wanted.page, wanted.announced_for, context.say).run())
        return found


PAGE = PageService()
