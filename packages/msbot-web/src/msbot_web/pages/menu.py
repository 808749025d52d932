"""The menu: which pages there are, and for whom."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

from nicegui import ui

from msbot.operations.rights import Right
from msbot_web.pages.easy_reading import ENTRIES
from msbot_web.pages.extension_page import brought_pages
from msbot_web.pages.lost_parts import lost_slots, notify_lost
from msbot_xrce.lazy import dataclass

if TYPE_CHECKING:
    from msbot_web.pages.layout import Page


@dataclass(frozen=True, slots=True)
class MenuEntry:
    """One entry of the menu."""

    path: str
    icon: str
    title: str
    right: Right = Right.SEE


MENU = (
    MenuEntry("/", "smart_toy", "Robot"),
    MenuEntry("/arrivals", "move_to_inbox", "Arrivals"),
    MenuEntry("/settings", "tune", "Settings"),
    MenuEntry("/bus", "cable", "Bus"),
    MenuEntry("/wires", "hub", "Wires"),
    MenuEntry("/program", "code", "Program", Right.JOIN),
    MenuEntry("/arena", "sports_esports", "Arena"),
    MenuEntry("/plots", "ssid_chart", "Plots"),
    MenuEntry("/timeline", "timeline", "Timeline"),
    MenuEntry("/learn", "school", "Learn"),
    MenuEntry("/library", "menu_book", "Library"),
    MenuEntry("/journal", "history", "Journal"),
    MenuEntry("/missions", "travel_explore", "Missions"),
    MenuEntry("/doctor", "medical_services", "Doctor", Right.ARRANGE),
    MenuEntry("/faults", "bug_report", "Faults", Right.ARRANGE),
    MenuEntry("/pupils", "groups", "Pupils", Right.ARRANGE),
    MenuEntry("/class", "grid_view", "Class"),
    MenuEntry("/admin", "manage_accounts", "Admin", Right.ADMINISTER),
)


def show_menu(page: Page, path: str, button: ui.button) -> None:
    """The menu, and the button that opens and closes it.

    Args:
        page: the page it is on.
        path: which entry is that page.
        button: the one in the header.
    """
    drawer = _drawer()
    with drawer:
        brought = [MenuEntry(path, one.icon, one.title, one.right) for path, one in brought_pages().items()]
        ways = [way for way in (*MENU, *brought) if page.may(way.right)]
        others = [way for way in ways if page.easy and way.path not in ENTRIES and way.path != path]
        _entries(page, path, [way for way in ways if way not in others])
        if others:
            with ui.element("details").classes("w-full"):
                with ui.element("summary"):
                    ui.label(page.say("More"))
                _entries(page, path, others)
        notify_lost(page)
    button.on("click", js_handler=f"() => getElement({drawer.id}).toggle()")


def _drawer() -> ui.element:
    """What the menu is in: open beside a wide page, over a narrow one when the button is pressed.

    It is the browser's alone. NiceGUI's own drawer tells the server when it opens, which says so back: late, that opened
    it over a window that had been made narrow meanwhile.
    """
    client = ui.context.client
    with client.layout as frame:
        drawer = ui.element("q-drawer").classes("nicegui-drawer ms-nav")
    drawer.props("show-if-above side=left width=210 breakpoint=900 role=navigation")
    view = list(frame.props["view"])
    view[4] = "L"  # it stays when the page is scrolled
    frame.props["view"] = "".join(view)
    drawer.move(target_index=frame.default_slot.children.index(client.page_container))
    return drawer


def _entries(page: Page, path: str, ways: Sequence[MenuEntry]) -> None:
    for way in ways:
        with ui.link(target=way.path).props('aria-current="page"' if way.path == path else ""):
            ui.icon(way.icon, size="1.3rem").props("aria-hidden=true")
            ui.label(page.say(way.title))
            if way.path == "/":
                _count(page, lambda: len(lost_slots(page.service.robot())), "bad")
            elif way.path == "/arrivals":
                _count(page, lambda: page.service.robot().arrivals, "")


def _count(page: Page, of: Callable[[], int], look: str) -> None:
    """A number behind an entry of the menu; nothing at 0."""
    count = ui.label("").classes(f"count {look}")

    def show() -> None:
        number = of()
        count.set_text(str(number))
        count.set_visibility(number > 0)

    page.every_look(show)
