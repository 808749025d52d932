"""The wires page: who publishes what to whom, drawn with rates; changed by mouse or keyboard, each change undoable."""

from __future__ import annotations

import json
from collections.abc import Awaitable, Callable, Mapping
from functools import partial

from fastapi import Request
from nicegui import ui
from nicegui.events import GenericEventArguments

from msbot.config import BOARD_DRIVERS, PartType, WiredPart, wired_part, wired_parts
from msbot.config.library.board_wiring import CHIPS, pin_faults
from msbot.hardware.wiring_picture import wiring_picture
from msbot.operations.rights import Right
from msbot.service_types import service_type
from msbot_web.html import Markup, render
from msbot_web.models.robot_models import TopicLine, WirePort
from msbot_web.page_errors import read_from_browser
from msbot_web.pages.layout import page_frame
from msbot_web.pages.page import Page
from msbot_web.pages.page_elements import heading, set_html, show_dialog
from msbot_web.pages.slot_dialogs import ask_for_slot, ask_to_take_out, connect_ports, make_wire, say_misfit
from msbot_web.root_path import root
from msbot_web.service import Service
from msbot_web.svg.drawings import value_words
from msbot_web.svg.wiring_graph import box_colour, rate_words, wiring_svg
from msbot_xrce.errors import ConfigError, MsbotError


def register(service: Service) -> None:
    """Make the page known."""

    @ui.page("/wires")
    def wires(request: Request) -> None:
        with page_frame(service, request, "/wires", "Wires") as page:
            ui.add_head_html(f'<script src="{root()}/web/wires.js"></script>')
            _Drawing(page)
            if page.may(Right.DESIGN):
                _Unwired(page)
            _table(page)


class _Drawing:
    """The graph; drawn again only when the wiring has changed, so that it stays still under a person's hand."""

    def __init__(self, page: Page) -> None:
        self._page = page
        self._shown: object = None
        self._rates: dict[str, tuple[str, bool]] = {}
        self._colours: dict[str, str] = {}
        self._may_change = page.may(Right.DESIGN)
        self._by_finger = False
        with ui.element("div").classes("panel"):
            with ui.element("div").classes("row spread"):
                ui.label(
                    page.translate("Green: samples are flowing. Dashed: silence. Click a slot to open it.")
                ).classes("soft")
                with ui.element("div").classes("row"):
                    new = ui.button(page.translate("New slot"), icon="add", on_click=lambda: ask_for_slot(page))
                    self._only_now: list[ui.element] = [new]
                    ui.button(page.translate("Picture (SVG)"), icon="image", on_click=self._save).props("flat")
            if self._may_change:
                hint = ui.label(
                    page.translate(
                        "Drag from one port to another, or click one after the other, or press Enter on both: ports that "
                        "fit light up. Delete disconnects a port, the cross removes a slot. The journal undoes each change."
                    )
                ).classes("soft ms-by-mouse")
                self._only_now.append(hint)
            narrow = [page.translate("The drawing goes on to the right: swipe, or scroll.")]
            if self._may_change:
                narrow.append(
                    page.translate(
                        "Tap two ports, one after the other, to join them, or one and then Disconnect. The cross removes "
                        "a slot. The journal undoes each change."
                    )
                )
            ui.label(" ".join(narrow)).classes("soft ms-narrow")
            self._element = ui.html("", sanitize=False).classes("w-full scroll ms-shaded").props("tabindex=0")
            if self._may_change:
                # A finger has no Delete: whoever picks a wired port up with it gets this button.
                cut = ui.button(page.translate("Disconnect"), icon="link_off").classes("ms-wire-cut")
                self._element.on("wire", self._told)
                ui.run_javascript(
                    f"msbotWires(getHtmlElement({self._element.id}), (deed) => "
                    f"getHtmlElement({self._element.id}).dispatchEvent(new CustomEvent('wire', {{detail: deed}})), "
                    f"getHtmlElement({cut.id}))"
                )
                ui.on("ms_touch", self._touched)
                ui.run_javascript("if (matchMedia('(any-pointer: coarse)').matches) emitEvent('ms_touch')")
        page.every_look(self._show)

    def _touched(self) -> None:
        """There is a touch screen: fingers need larger ports."""
        self._by_finger = True
        self._show()

    def _show(self) -> None:
        sight, is_past = self._page.sight, self._page.is_past
        may_change = self._may_change and not is_past
        for one in self._only_now:
            one.set_visibility(may_change)
        topics, ports = sight.topics(), sight.ports()
        states = {card.name: card.state for card in sight.robot().slots}
        colours = {slot: box_colour(state) for slot, state in states.items()}
        by_finger = self._by_finger
        wiring = (
            may_change,
            is_past,
            by_finger,
            [(one.topic, one.publishers, one.subscribers) for one in topics],
            ports,
        )
        rates = {one.topic: (rate_words(one, self._page.language, is_past=is_past), one.rate_hz > 0) for one in topics}
        if wiring != self._shown:
            self._shown, self._rates, self._colours = wiring, rates, colours
            drawing = wiring_svg(
                topics,
                ports,
                states,
                self._page.language,
                may_change=may_change,
                is_past=is_past,
                by_finger=by_finger,
            )
            self._element.set_content(drawing)
            return
        changed = {topic: rate for topic, rate in rates.items() if self._rates.get(topic) != rate}
        if changed:
            self._rates.update(changed)
            ui.run_javascript(f"msbotRates({json.dumps(changed)})")
        other = {slot: colour for slot, colour in colours.items() if self._colours.get(slot) != colour}
        if other:
            self._colours = colours
            ui.run_javascript(f"msbotBoxes({json.dumps(other)})")

    def _save(self) -> None:
        sight = self._page.sight
        states = {card.name: card.state for card in sight.robot().slots}
        drawing = wiring_svg(sight.topics(), sight.ports(), states, self._page.language, is_past=self._page.is_past)
        ui.download.content(str(drawing), "wires.svg")

    async def _told(self, event: GenericEventArguments) -> None:
        with read_from_browser():
            told = event.args["detail"]
            deed, start, end = str(told["deed"]), str(told["from"]), str(told["to"])
        if deed == "take_out":
            ask_to_take_out(self._page, start)
        elif deed == "misfit":
            say_misfit(self._page, start, end)
        elif deed == "cut":
            await self._page.act("unbind", topic=end, port=start)
        else:
            await connect_ports(self._page, start, end)


MOST_UNWIRED = 24
"""Ports that are offered a wire of their own; the drawing has all."""


class _Unwired:
    """Ports without a wire: each gets one of its own with one press."""

    def __init__(self, page: Page) -> None:
        self._page = page
        self._buttons: dict[str, ui.button] = {}
        with ui.element("div").classes("panel") as self._panel:
            heading(page.translate("Ports without a wire"))
            ui.label(
                page.translate(
                    "Join them with others in the drawing, or press one to give it a wire of its own: people can then "
                    "look at it, call it or send to it."
                )
            ).classes("soft")
            self._row = ui.element("div").classes("row")
        page.every_look(self._show, self._panel)

    def _show(self) -> None:
        ports = [] if self._page.is_past else self._page.service.views.ports()
        wanted = [f"{port.slot}.{port.port}" for port in ports if not port.topic and not _only_calls(port)][
            :MOST_UNWIRED
        ]
        for gone in self._buttons.keys() - set(wanted):
            self._buttons.pop(gone).delete()
        for place, end in enumerate(wanted):
            if end not in self._buttons:
                with self._row:
                    make = partial(make_wire, self._page, end)
                    self._buttons[end] = ui.button(end, icon="add_link", on_click=make).props("outline no-caps dense")
                self._buttons[end].move(target_index=place)
        self._panel.set_visibility(bool(wanted))


def _only_calls(port: WirePort) -> bool:
    """Whether a port calls: a wire without a part that serves is of no use to it."""
    return not port.publishes and service_type(port.type_name) is not None


def _table(page: Page) -> None:
    table = ui.html("", sanitize=False).classes("panel scroll").props("tabindex=0")
    titles = ("Topic", "Type", "From", "To", "Rate", "Samples", "Latest value")

    def show() -> None:
        rows = [_row(topic, page) for topic in page.sight.topics()]
        empty = page.translate(
            "Nothing is wired yet. Drag from one port to another in the drawing above."
            if page.may(Right.DESIGN)
            else "Nothing is wired yet."
        )
        content = render("table", heads=[page.translate(title) for title in titles], rows=rows or [(empty,)])
        set_html(table, content)

    page.every_look(show)


def _row(topic: TopicLine, page: Page) -> tuple[str, ...]:
    values = ", ".join(f"{name} {value_words(value, page.language)}" for name, value in topic.fields.items())
    return (
        topic.topic,
        topic.type_name,
        ", ".join(topic.publishers),
        ", ".join(topic.subscribers),
        f"{page.number(topic.rate_hz, '.1f')} Hz",
        "–" if page.is_past else str(topic.count),
        values,
    )


# A form for what is wired to a board: part type, name, pins, address and options, with the picture of its wires.
#
# It writes the text that people write into `part_1` (`msbot.config.library.board_wiring`), checks it against the board's
# other parts while somebody types, and sets it as any setting is set, so that it can be undone.


OTHER_BOARD = ""


async def edit_wires(page: Page, slot: str, parameter: str, changed: Callable[[], Awaitable[None]]) -> None:
    """Open the form for one part of the board in a slot; `changed` is called after it has been set."""
    values = {value.name: str(value.value) for value in await page.service.values(slot) if value.kind == "part"}
    with ui.dialog() as dialog, ui.card().style("max-width:56rem;width:100%"):
        ui.label(page.translate("What is wired to {board}: {place}", board=slot, place=parameter)).props(
            "role=heading aria-level=2"
        )
        form = _Form(page, values, parameter)

        async def save(text: str) -> None:
            if await page.act("set", slot=slot, name=parameter, value=text) is not None:
                dialog.close()
                await changed()

        with ui.element("div").classes("row"):
            form.save = ui.button(page.translate("Wire it so"), icon="check", on_click=lambda: save(form.text()))
            ui.button(page.translate("Nothing is wired"), icon="delete", on_click=partial(save, "")).props("outline")
            ui.button(page.translate("Cancel"), on_click=dialog.close).props("flat")
        form.look()
    show_dialog(dialog)


class _Form:
    """The fields; the picture and the sentences beside them follow each key."""

    save: ui.button

    def __init__(self, page: Page, values: Mapping[str, str], parameter: str) -> None:
        self._page = page
        self._library = page.service.views.library
        self._others = {name: text for name, text in values.items() if name != parameter and text.strip()}
        self._parameter = parameter
        now = self._now(values.get(parameter, ""))
        types = {
            one.number: f"{one.number}: {page.translate(one.name)}" for one in self._library if one.driver.board.driver
        }
        self._fields: dict[str, ui.input] = {}
        with ui.element("div").classes("row").style("align-items:flex-start;gap:1.5rem"):
            with ui.column().style("flex:1;min-width:min(15rem,100%);gap:.3rem"):
                self._number = ui.select(types, label=page.translate("Part type"), value=now and now.part_type.number)
                self._number.props("dense use-input").classes("w-full").on_value_change(lambda: self._fill(None))
                self._name = ui.input(page.translate("Name of its slot"), value=now.name if now else "").props("dense")
                self._name.classes("w-full").on_value_change(self.look)
                boards = {
                    OTHER_BOARD: page.translate("another board: its pins are not checked"),
                    **{one: one for one in CHIPS},
                }
                self._board = ui.select(boards, label=page.translate("Board"), value=OTHER_BOARD).props("dense")
                self._board.classes("w-full").on_value_change(self.look)
                self._wires = ui.column().classes("w-full").style("gap:.3rem")
            with ui.column().style("flex:2;min-width:min(18rem,100%)"):
                self._picture = ui.html("", sanitize=False).classes("wiring w-full").props("tabindex=0")
                self._says = ui.html("", sanitize=False).classes("w-full").props("aria-live=polite")
        self._fill(now)

    def text(self) -> str:
        """The form as the text that is set."""
        number, name = str(self._number.value or ""), str(self._name.value or "").strip()
        pairs = [f"{key}={str(field.value).strip()}" for key, field in self._fields.items() if str(field.value).strip()]
        return f"{number} {name}".strip() + ": " + ", ".join(pairs)

    def look(self) -> None:
        """Check what the form says, and draw it."""
        part_type, say = self._type(), self._page.translate
        faults: list[str] = []
        part: WiredPart | None = None
        if part_type is not None:
            try:
                part = wired_part(self.text(), self._library)
                wired_parts({**self._others, self._parameter: self.text()}, self._library)
            except ConfigError as error:
                faults.append(say(str(error)) if not error.args else say(error.args[0]))
            if part is not None:
                faults += [say(fault) for fault in pin_faults(str(self._board.value), part)]
            pins: Mapping[str, int | str] = {
                wire: str(field.value).strip()
                for wire, field in self._fields.items()
                if wire in part_type.driver.board.pins and str(field.value).strip()
            }
            set_html(
                self._picture, Markup(wiring_picture(part_type, pins, str(self._board.value) or say("board"), say))
            )
        set_html(self._says, render("lines", say=say, lines=faults))
        if hasattr(self, "save"):
            self.save.set_enabled(part is not None and not faults)

    def _now(self, text: str) -> WiredPart | None:
        try:
            return wired_part(text, self._library)
        except MsbotError:  # written by hand, and the form starts anew
            return None

    def _type(self) -> PartType | None:
        return self._library.find(str(self._number.value or ""))

    def _fill(self, now: WiredPart | None) -> None:
        """The fields of the chosen type."""
        part_type = self._type()
        self._wires.clear()
        self._fields = {}
        if part_type is not None:
            spec, say = part_type.driver, self._page.translate
            with self._wires:
                for wire in spec.board.pins:
                    self._field(
                        wire, say("pin for {wire}", wire=wire), "" if now is None else str(now.pins.get(wire, ""))
                    )
                if BOARD_DRIVERS[spec.board.driver].on_i2c:
                    address = spec.addresses[0] if now is None or now.address is None else now.address
                    known = ", ".join(f"0x{one:02x}" for one in spec.addresses)
                    self._field("address", say("address: {known}", known=known), f"0x{address:02x}")
                for option in spec.options:
                    value = option.default if now is None else now.options[option.name]
                    shown = str(value).lower() if isinstance(value, bool) else str(value)
                    self._field(option.name, f"{option.name}: {say(option.description)}", shown)
        self.look()

    def _field(self, key: str, words: str, value: str) -> None:
        made = ui.input(words, value=value).props("dense").classes("w-full")
        made.on_value_change(self.look)
        self._fields[key] = made
