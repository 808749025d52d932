"""The menu: which pages there are, for whom, and in which group; pupils have a short one. And the search for all."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING
from urllib.parse import quote

from nicegui import ui

from msbot.operations.rights import Right
from msbot_agent.text.sentence import said
from msbot_web.handbook import FOR_PUPILS, handbook_names, title_of
from msbot_web.html import render
from msbot_web.pages.easy_reading import ENTRIES
from msbot_web.pages.extension_page import brought_pages
from msbot_web.pages.lost_parts import lost_slots, notify_lost
from msbot_xrce.lazy import dataclass

if TYPE_CHECKING:
    from msbot_web.pages.page import Page


@dataclass(frozen=True, slots=True)
class MenuEntry:
    """One entry of the menu."""

    path: str
    icon: str
    title: str
    right: Right = Right.SEE
    group: str = ""
    """The heading that it stands under."""


ROBOT, TEACH, LOOK, CARE = said("Robot"), said("Teach"), said("Look"), said("Care")
GROUPS = (ROBOT, TEACH, LOOK, CARE)
MENU = (
    MenuEntry("/", "smart_toy", "Robot", Right.SEE, ROBOT),
    MenuEntry("/arrivals", "move_to_inbox", "Arrivals", Right.SEE, ROBOT),
    MenuEntry("/settings", "tune", "Settings", Right.SEE, ROBOT),
    MenuEntry("/wires", "hub", "Wires", Right.SEE, ROBOT),
    MenuEntry("/program", "code", "Program", Right.JOIN, ROBOT),
    MenuEntry("/arena", "sports_esports", "Arena", Right.SEE, ROBOT),
    MenuEntry("/gallery", "apps", "Robots and worlds", Right.SEE, TEACH),
    MenuEntry("/learn", "school", "Learn", Right.SEE, TEACH),
    MenuEntry("/missions", "travel_explore", "Missions", Right.SEE, TEACH),
    MenuEntry("/faults", "bug_report", "Faults", Right.ARRANGE, TEACH),
    MenuEntry("/pupils", "groups", "Pupils", Right.ARRANGE, TEACH),
    MenuEntry("/bus", "cable", "Bus", Right.SEE, LOOK),
    MenuEntry("/plots", "ssid_chart", "Plots", Right.SEE, LOOK),
    MenuEntry("/timeline", "timeline", "Timeline", Right.SEE, LOOK),
    MenuEntry("/journal", "history", "Journal", Right.SEE, LOOK),
    MenuEntry("/library", "menu_book", "Library", Right.SEE, LOOK),
    MenuEntry("/class", "grid_view", "Class", Right.SEE, CARE),
    MenuEntry("/doctor", "medical_services", "Doctor", Right.ARRANGE, CARE),
    MenuEntry("/admin", "manage_accounts", "Admin", Right.ADMINISTER, CARE),
)
HELP_ENTRY = MenuEntry("/handbook", "help_outline", "Help")
PUPILS_ENTRIES = frozenset({"/", "/program", "/learn", "/arena", "/handbook"})
"""A pupil's menu; the other pages are behind one more word, or found by the search."""


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
        if is_pupil(page):
            ways.append(HELP_ENTRY)
        short = PUPILS_ENTRIES if is_pupil(page) else ENTRIES if page.easy else None
        others = [way for way in ways if short is not None and way.path not in short and way.path != path]
        groups = (
            _groups(page, ways)
            if short is None
            else [{"title": "", "ways": [way for way in ways if way not in others]}]
        )
        counts = _Counts(page, ways)
        # One element: thirty open pages would keep thousands of them otherwise.
        text = render("menu", say=page.translate, groups=groups, others=others, path=path, counts=counts.shown)
        ui.html(text, sanitize=False).classes("ms-nav-entries")
        page.every_look(counts.show)
        notify_lost(page)
    button.on("click", js_handler=f"() => getElement({drawer.id}).toggle()")


def is_pupil(page: Page) -> bool:
    """Whether somebody takes part who does not teach."""
    return page.may(Right.OPERATE) and not page.may(Right.ARRANGE)


def search_button(page: Page) -> None:
    """What opens the search, beside Ctrl-K; and the search itself, which is the browser's (`static/find.js`)."""
    words = page.translate("Find (Ctrl-K)")
    button = ui.button(icon="search").props("flat round dense color=primary id=ms-find-open")
    button.props["aria-label"] = button.props["title"] = words
    groups = page.service.operations.pupils.groups
    group_of = {slot: group.name for group in groups for slot in group.slots}
    more = [
        [card.name, group_of.get(card.name, page.translate(card.type_name)), f"/?slot={quote(card.name)}"]
        for card in page.service.robot().slots
    ]
    if page.may(Right.ARRANGE):
        names = {name: group.name for group in groups for name in group.pupils}
        names |= {name: names.get(name, "") for name in page.service.pupils.pupils()}
        more += [[name, names[name], f"/pupil?name={quote(name)}"] for name in sorted(names, key=str.casefold)]
    more += _behind_pages(page)
    ui.add_body_html(str(render("find", say=page.translate, more=json.dumps(more))))


def _behind_pages(page: Page) -> list[list[str]]:
    """What the menu does not have: pages behind pages, and those of the handbook that are for the person."""
    say = page.translate
    book = say("Handbook")
    found = [[say("Quiz"), say("Learn"), "/learn/quiz"], [book, say("Help"), "/handbook"], ["API", "", "/api-docs"]]
    if page.may(Right.ARRANGE):
        found.append([say("Our class"), say("Pupils"), "/projector"])
    names = FOR_PUPILS if is_pupil(page) else handbook_names("tutorial", "howto", "explain")
    return found + [[title_of(name) or name, book, f"/handbook/{name}"] for name in names]


def _groups(page: Page, ways: Sequence[MenuEntry]) -> list[Mapping[str, object]]:
    """The entries under their headings."""
    found = [
        {"title": page.translate(group or "More"), "ways": [way for way in ways if way.group == group]}
        for group in (*GROUPS, "")  # what extensions bring comes last
    ]
    return [group for group in found if group["ways"]]


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


class _Counts:
    """The numbers behind entries of the menu; none at 0."""

    def __init__(self, page: Page, ways: Sequence[MenuEntry]) -> None:
        service = page.service
        known: Mapping[str, Callable[[], int]] = {
            "/": lambda: len(lost_slots(service.glance())),
            "/arrivals": lambda: service.glance().arrivals,
            "/pupils": lambda: len(service.pupils.passes.waiting.names()),
        }
        self._of = {way.path: known[way.path] for way in ways if way.path in known}
        self.shown = self._now()

    def show(self) -> None:
        """Tell the browser what has changed."""
        now = self._now()
        changed = {path: number for path, number in now.items() if self.shown[path] != number}
        if changed:
            self.shown = now
            ui.run_javascript(f"msbotMenuCounts({json.dumps(changed)})")

    def _now(self) -> dict[str, int]:
        return {path: of() for path, of in self._of.items()}
