"""Help in the page: "?" on every page, the handbook, and a tour of one minute for the first visit."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

from fastapi import Request
from nicegui import ui

from msbot_xrce.lazy import dataclass

if TYPE_CHECKING:
    from msbot_web.pages.page import Page

TOUR_COOKIE = "msbot_tour"
"""Set by the browser of somebody who has taken the tour, or does not want to."""


@dataclass(frozen=True, slots=True)
class PageHelp:
    """What the "?" of one page says."""

    words: str
    """Three sentences."""
    page: str
    """The page of the handbook that tells more."""


@dataclass(frozen=True, slots=True)
class TourStep:
    """One stop of the tour."""

    words: str
    target: str
    """CSS selector of what it is about; the page shows a frame around it."""


HELP = {
    "/": PageHelp(
        "Every card is a slot: a role in the robot that a part fills. Its colour and word say how the part is, the ring "
        "when it last gave a beat. Click a card for its settings, its wires and the reason for its state.",
        "howto/web_page",
    ),
    "/arrivals": PageHelp(
        "Parts that want to join but have no slot wait here, each with the reason. A teacher opens the adoption "
        "window and lets a part in with one click. Whatever is done here can be undone in the journal.",
        "howto/swap_a_part",
    ),
    "/settings": PageHelp(
        "Here the robot is described: its slots, what is wired to what, and its blueprint as text. Every change is "
        "checked and shown before it counts. What was changed by hand stays until somebody undoes it.",
        "howto/blueprint_changes",
    ),
    "/arena": PageHelp(
        "The world that simulated robots drive in, live. Drag a robot to put it elsewhere, pause the world, let it go "
        "slower, and drive by hand. What a robot senses here, its parts publish as messages.",
        "howto/arena",
    ),
    "/gallery": PageHelp(
        "Each card is a robot, alone or in a world, and says what can be learned with it. A teacher starts it with "
        "a click; then this page shows the new robot. Before that, the page names what would end.",
        "howto/web_page",
    ),
    "/bus": PageHelp(
        "Every line is a frame on the CAN bus, in words. Click a line to take the frame apart, bit by bit. The bar "
        "shows how busy the bus is: above 80 % parts begin to wait for each other.",
        "howto/watch_the_bus",
    ),
    "/wires": PageHelp(
        "Parts do not know each other: a part publishes on a topic, and every part that is wired to it gets the "
        "messages. Green lines carry messages now, dashed ones are silent. A teacher joins ports, makes slots and "
        "takes them out.",
        "explain/plug_and_play",
    ),
    "/program": PageHelp(
        "Write a program in Python, or press Blocks and put it together, and press Run: it runs in this browser, and "
        "its part joins the robot as any other. Lines with a mistake are marked, and the console shows what the program "
        "prints. Begin with an example, and change it; in the text, Tab moves a line in, Escape and then Tab leaves it.",
        "howto/program_in_the_browser",
    ),
    "/plots": PageHelp(
        "Every number of the robot as a curve: what parts say, their settings, the load of the bus, the time between "
        "beats. Choose several, zoom with the wheel, drag into the past; what is older than five minutes comes from the "
        "flight recorder. The table tells mean, least and greatest value of what you see.",
        "howto/plots",
    ),
    "/timeline": PageHelp(
        "Each bar is a slot; its colour is the state it had at that time. Below the bars stands why each state began. "
        "What the parts said at that time is on the page Plots.",
        "howto/web_page",
    ),
    "/learn": PageHelp(
        "A lesson says step by step what to do at this robot, and ticks by itself when it is done. A teacher begins a lesson "
        "and ends it; then everything is as it was before. Whoever takes part keeps the ticks, and asks for help with a raised hand.",
        "howto/lessons",
    ),
    "/pupils": PageHelp(
        "Everybody in the class, those who ask for help first. Freeze all pauses every pupil's program, and what it "
        "drives gets its safe value; STOP is something else, and stops the whole robot. Groups have slots of their "
        "own; a pasted list makes accounts with tickets to print.",
        "howto/classroom",
    ),
    "/projector": PageHelp(
        "The class at a glance, for the wall: parts, programs, raised hands and the lesson of each group. It shows no "
        "names unless they are turned on, and nothing secret.",
        "howto/classroom",
    ),
    "/library": PageHelp(
        "The library knows what a part number means: ports, settings, pins and safe values. Search by what a part "
        "does, or by its number. A part type of your own is one small file.",
        "howto/add_a_part_type",
    ),
    "/faults": PageHelp(
        "Here a teacher lets something go wrong on purpose: lost packets, a stuck sensor, a part that is pulled out. "
        "The part's card says that it is planted, unless it is hidden. Every fault ends by itself, and STOP ends all.",
        "howto/fault_lab",
    ),
    "/missions": PageHelp(
        'In a mission something goes wrong in the robot, and nobody says what. Look at cards, curves and "Why?", name '
        "the fault and its place, and have it mended. Wrong answers and hints cost marks; the report tells everything.",
        "howto/missions",
    ),
    "/journal": PageHelp(
        "The journal keeps what happened to every part, with the evidence. Changes by people stand beside it, each "
        "with its undo. Search for a part, a slot or a UID.",
        "howto/web_page",
    ),
    "/doctor": PageHelp(
        "The doctor examines the computer, its buses and the robot, and lists what is wrong. Each finding has the "
        "command that mends it. What can be undone is mended with one click.",
        "howto/find_what_is_wrong",
    ),
    "/class": PageHelp(
        "Every tile is a robot of your class. Its colour says at a glance whether all its parts are there. Click a "
        "tile to go to that robot.",
        "howto/class",
    ),
    "/admin": PageHelp(
        "Here an administrator decides who may sign in and what they may do: viewers look, students operate, "
        "teachers change the robot, administrators do everything. Programs sign in with API tokens. A backup keeps "
        "the whole robot in one file.",
        "howto/database",
    ),
}
"""What the "?" says, by the path of the page."""

TOUR = (
    TourStep("Welcome! This is your robot. Every card is a slot, and a part fills it.", ".grid"),
    TourStep("The colour and the word say how a part is. The ring runs while it waits for the next beat.", ".place"),
    TourStep("Click a card: settings, wires, and why the part is as it is.", ".place"),
    TourStep("New or refused parts wait under Arrivals, each with its reason.", '.ms-nav a[href$="/arrivals"]'),
    TourStep("STOP puts every part into its safe state, from every page. Escape twice does the same.", "#ms-stop"),
    TourStep("Lost? The question mark explains the page you are on.", ".ms-help"),
)
"""The tour: short enough for one minute."""


def help_button(page: Page, path: str) -> None:
    """The "?" of a page; nothing where there is no help."""
    about = HELP.get(path)
    if about is None:
        return
    button = ui.button(icon="help_outline").props("flat round dense color=primary aria-haspopup=dialog")
    button.props["aria-label"] = page.translate("Help for this page")
    with (
        button.classes("ms-help"),
        ui.menu().props(
            f'anchor="bottom right" self="top right" role=dialog aria-label="{page.translate("Help for this page")}"'
        ),
        ui.column().style("padding:1rem;max-width:22rem;gap:.6rem"),
    ):
        ui.label(page.translate(about.words))
        ui.link(page.translate("More in the handbook"), f"/handbook/{about.page}")
        ui.link(page.translate("All pages of the handbook"), "/handbook")
        if path == "/":
            ui.button(page.translate("Take the tour"), on_click=partial(start_tour, page)).props("outline dense")


def offer_tour(page: Page, request: Request) -> None:
    """On the first visit: a line that offers the tour, and goes for good when it is taken or declined."""
    if request.cookies.get(TOUR_COOKIE):
        return

    def take() -> None:
        start_tour(page)
        offer.delete()

    def decline() -> None:
        _remember()
        offer.delete()

    with ui.element("div").classes("ms-banner info row spread ms-tour-offer").props("role=note") as offer:
        ui.label(page.translate("Your first visit? A tour shows you round in one minute."))
        with ui.element("div").classes("row"):
            ui.button(page.translate("Take the tour"), on_click=take).props("dense")
            if page.service.gallery.may_change(page.session):  # at a demo nobody else begins a lesson
                lessons = ui.button(page.translate("To the first lesson"), on_click=lambda: ui.navigate.to("/learn"))
                lessons.props("dense outline")
            ui.button(page.translate("Not now"), on_click=decline).props("flat dense")


def start_tour(page: Page) -> None:
    """Lead the person round: one card at the bottom, a frame around what it is about."""
    _remember()
    at = 0
    with (
        ui.context.client.content,
        ui.element("div").classes("ms-tour").props("role=dialog aria-live=polite aria-modal=false") as card,
    ):
        words = ui.label("")
        with ui.element("div").classes("row spread"):
            count = ui.label("").classes("soft num")
            with ui.element("div").classes("row"):
                back = ui.button(page.translate("Back")).props("flat dense")
                onward = ui.button(page.translate("Next")).props("dense")
                end = ui.button(page.translate("End the tour")).props("flat dense")

    def show(step: int) -> None:
        nonlocal at
        at = step
        if at == len(TOUR):
            finish()
            return
        words.set_text(page.translate(TOUR[at].words))
        count.set_text(f"{at + 1} / {len(TOUR)}")
        back.set_enabled(at > 0)
        onward.set_text(page.translate("Next") if at + 1 < len(TOUR) else page.translate("Done"))
        ui.run_javascript(f"msbotFrame({TOUR[at].target!r})")

    def finish() -> None:
        ui.run_javascript("msbotFrame('')")
        card.delete()

    back.on_click(lambda: show(at - 1))
    onward.on_click(lambda: show(at + 1))
    end.on_click(finish)
    show(0)


def _remember() -> None:
    ui.run_javascript(f"document.cookie = '{TOUR_COOKIE}=seen;path=/;max-age=31536000;samesite=lax'")
