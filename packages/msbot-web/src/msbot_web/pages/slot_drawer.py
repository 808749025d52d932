"""The drawer of one slot: identity, settings, wiring, rhythm, history, and the reasons for its state."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Awaitable, Callable, Iterator, Mapping
from functools import partial
from typing import Any, NamedTuple
from urllib.parse import quote

from nicegui import ui
from nicegui.events import ValueChangeEventArguments

from msbot.config import Direction, EnumType, FieldKind, LeafType, MessageType, Port, Scalar
from msbot.hardware.wiring_picture import wiring_picture
from msbot.operations.rights import Right
from msbot.pnp import PartState
from msbot_web.html import Markup, render
from msbot_web.models.robot_models import PartLine, SlotCard
from msbot_web.pages.number_field import NumberField
from msbot_web.pages.page import Page
from msbot_web.pages.page_elements import heading, set_html, show_dialog
from msbot_web.pages.parameter_form import parameter_panel
from msbot_web.pages.simulator import simulator_panel
from msbot_web.pages.slider import Slider
from msbot_web.pages.slot_dialogs import make_wire, wire_port
from msbot_web.svg.drawings import HELD_WORDS, done_fields, draw, fields_html, sparkline, state_chip
from msbot_xrce.errors import MsbotError, NotThere

# Driving a slot's ports by hand: a slider, a switch, a colour or a text for each port that hears something.
#
# While the switch "by hand" is on the page holds the port and renews it; when the page is closed, nobody does, and the
# port gets its safe value and follows its wire again (`msbot.operations.manual_control`).


HELD_S = 3.0
"""A port is held for this long at a time."""
RENEW_S = 1.0
COLOUR = ["red", "green", "blue"]
RANGES = {"%": (-100.0, 100.0), "deg": (-180.0, 180.0), "Hz": (0.0, 5000.0), "1/min": (-600.0, 600.0), "s": (0.0, 60.0)}
"""What a slider offers where the port declares no range, by the unit of the field."""


def manual_control_panel(page: Page, slot: str, part_number: str) -> None:
    """The controls for every port of a slot that can be driven; nothing when there is none, or no right to."""
    part_type = page.service.views.library.find(part_number) if part_number else None
    if part_type is None or not page.may_at(Right.OPERATE, slot):
        return
    services = [port for port in part_type.ports if port.direction is Direction.SERVE and port.message is not None]
    if services:
        with ui.element("div").classes("panel"):
            ui.label(page.translate("Call")).props("role=heading aria-level=2").style(
                "font-weight:650;font-size:1.1rem"
            )
            ui.label(page.translate("Sends a request to the part, and shows its reply.")).classes("soft")
            for port in services:
                assert port.message is not None
                _ServiceControl(page, slot, port, port.message)
    ports = [port for port in part_type.ports if port.direction is Direction.SUBSCRIBE and port.message is not None]
    if not ports:
        return
    with ui.element("div").classes("panel"):
        ui.label(page.translate("Drive by hand")).props("role=heading aria-level=2").style(
            "font-weight:650;font-size:1.1rem"
        )
        ui.label(
            page.translate("Meanwhile messages from the wire are ignored. Afterwards the port gets its safe value.")
        ).classes("soft")
        for port in ports:
            assert port.message is not None
            _PortControl(page, slot, port, port.message)


class _PortControl:
    """One port, and what a person sets it to."""

    def __init__(self, page: Page, slot: str, port: Port, message: MessageType) -> None:
        self._page = page
        self._where = f"{slot}.{port.name}"
        self._values: dict[str, Scalar] = {name: kind.zero for name, kind in message.leaves.items()}
        self._values |= dict(port.safe or {})
        self._saying = asyncio.Lock()
        """Values are sent one after the other, so that the last one set is the last one sent."""
        with ui.element("div").style("margin-top:.6rem;width:100%"):
            self._held = ui.switch(page.translate("{port} by hand", port=port.name), on_change=self._switched)
            with ui.element("div").style("padding-left:1rem;width:100%") as self._fields:
                _fields(page, message, self._values, self._changed, port.ranges)
        self._fields.bind_visibility_from(self._held, "value")
        self._renewing = ui.timer(RENEW_S, self._say, active=False)
        assert page.client is not None
        page.client.on_disconnect(self._gone)

    @property
    def _is_held(self) -> bool:
        slot, _, port = self._where.rpartition(".")
        return (slot, port) in self._page.service.operations.by_hand.held_ports()

    async def _switched(self) -> None:
        self._renewing.active = bool(self._held.value)
        if self._held.value:
            await self._say()
        else:
            await self._let_go()

    async def _changed(self, name: str, value: Scalar) -> None:
        self._values[name] = value
        if self._held.value:
            await self._say()

    async def _say(self) -> None:
        values = [f"{name}={_written(value)}" for name, value in self._values.items()]
        async with self._saying:
            done = await self._page.act("publish", quiet=True, port=self._where, values=values, seconds=HELD_S)
        if done is None:
            self._renewing.active = False
            self._held.value = False

    async def _let_go(self) -> None:
        if self._is_held:
            await self._page.act("let_go", quiet=True, port=self._where)

    async def _gone(self) -> None:
        """The page is closed or cannot be reached: nobody holds the control any more."""
        if self._held.value:
            self._renewing.active = False
            await self._let_go()
            self._held.value = False  # and whoever comes back to the page sees that


class _ServiceControl:
    """One port that serves: the fields of its request, and its reply."""

    def __init__(self, page: Page, slot: str, port: Port, message: MessageType) -> None:
        self._page = page
        self._where = f"{slot}.{port.name}"
        self._values: dict[str, Scalar] = {name: kind.zero for name, kind in message.leaves.items()}
        with ui.element("div").style("margin-top:.6rem;width:100%"):
            ui.label(port.name).style("font-weight:600")
            with ui.element("div").classes("row") as self._unwired:
                ui.label(page.translate("Nobody can call it before it has a wire.")).classes("soft")
                if page.may(Right.DESIGN):
                    ui.button(page.translate("Make its wire"), icon="add_link", on_click=self._wire).props("outline")
            with ui.element("div").style("padding-left:1rem;width:100%"):
                _fields(page, message, self._values, self._changed, port.ranges)
                self._button = ui.button(
                    page.translate("Call {port}", port=port.name), icon="send", on_click=self._call
                )
                self._reply = ui.label("").props("role=status").style("margin-top:.4rem")
        page.every_look(self._show, self._unwired)

    def _show(self) -> None:
        port = wire_port(self._page, self._where)
        is_wired = port is not None and bool(port.topic)
        self._unwired.set_visibility(not is_wired)
        self._button.set_visibility(is_wired)

    async def _wire(self) -> None:
        await make_wire(self._page, self._where)

    async def _changed(self, name: str, value: Scalar) -> None:
        self._values[name] = value

    async def _call(self) -> None:
        values = [f"{name}={_written(value)}" for name, value in self._values.items()]
        self._button.disable()
        self._reply.text = ""
        done = await self._page.act("call", quiet=True, port=self._where, values=values)
        if not self._page.is_gone:
            self._button.enable()
            self._reply.text = "" if done is None else self._page.translate(done.words)


Changed = Callable[[str, Scalar], Awaitable[None]]


def _fields(
    page: Page,
    message: MessageType,
    values: Mapping[str, Scalar],
    changed: Changed,
    ranges: Mapping[str, tuple[float, float]],
) -> None:
    """A control for each field; one for all three of a colour."""
    if list(message.fields) == COLOUR and all(kind is FieldKind.UINT8 for kind in message.fields.values()):
        _colour(page, values, changed)
        return
    for name, kind in message.leaves.items():
        unit = message.units.get(name, "")
        title = f"{name} [{unit}]" if unit else name
        take = partial(_take, changed, name, kind)
        if kind is FieldKind.BOOL:
            ui.switch(title, value=bool(values[name]), on_change=take)
        elif isinstance(kind, EnumType):
            ui.select(list(kind.names), label=title, value=str(values[name]), on_change=take).classes("w-full")
        elif kind is FieldKind.TEXT or not isinstance(kind, FieldKind):
            ui.input(title, value=str(values[name]), on_change=take).props("debounce=300")
        elif (name in ranges or unit in RANGES) and not kind.is_whole:
            least, most = ranges.get(name) or RANGES[unit]
            put = partial(changed, name)
            Slider(page.language, title, least=least, most=most, value=float(values[name]), unit=unit, on_number=put)
        else:
            field = NumberField(
                page, title, number=float(values[name]), is_whole=kind.is_whole, on_number=partial(changed, name)
            )
            field.props("debounce=300")


def _colour(page: Page, values: Mapping[str, Scalar], changed: Changed) -> None:
    async def take(event: ValueChangeEventArguments[str | None]) -> None:
        digits = str(event.value or "").lstrip("#")
        if len(digits) == 6:
            for place, name in enumerate(COLOUR):
                await changed(name, int(digits[2 * place : 2 * place + 2], 16))

    start = "#" + "".join(f"{int(values[name]):02x}" for name in COLOUR)
    ui.color_input(page.translate("Colour"), value=start, on_change=take)


async def _take(changed: Changed, name: str, kind: LeafType, event: ValueChangeEventArguments[Scalar | None]) -> None:
    if event.value is None:
        return  # the field was emptied: the last value holds
    await changed(name, int(event.value) if kind.is_whole else event.value)


def _written(value: Scalar) -> str:
    return str(value).lower() if isinstance(value, bool) else str(value)


WHY_LINES = 40


def open_slot_drawer(page: Page, slot: str) -> None:
    """Open the drawer of a slot; Back closes it. Of the past it has what was so, and nothing that can be done."""
    try:
        page.sight.slot(slot)
    except MsbotError as error:
        ui.notify(page.translate(str(error)), type="negative")
        return
    with ui.dialog().props("position=right full-height") as dialog, ui.card().classes("ms-drawer"):
        with ui.element("div").classes("row spread w-full").style("flex-wrap:nowrap"):
            heading(slot).style("font-size:1.35rem;min-width:0;overflow-wrap:anywhere")
            close = ui.button(icon="close", on_click=dialog.close).props("flat round dense")
            close.props["aria-label"] = close.props["title"] = page.translate("Close")
        if page.is_past:
            ui.label(page.translate("This was so at the chosen moment.")).classes("ms-banner info")
            _state(page, slot)
            _ports(page, slot)
        else:
            _present(page, slot)

    at_s = page.at_s

    def look_whether_there() -> None:
        if page.at_s != at_s:
            dialog.close()
            return
        try:
            page.sight.slot(slot)
        except NotThere as error:  # another blueprint holds by now
            ui.notify(page.translate(str(error)), type="warning")
            dialog.close()

    page.every_look(look_whether_there, dialog)
    show_dialog(dialog, f"/?slot={quote(slot)}")


def _present(page: Page, slot: str) -> None:
    """All about the slot as it is now."""
    _state(page, slot)
    if page.may_at(Right.OPERATE, slot):
        _following(page, slot, lambda card: card.simulated, lambda card: _simulator(page, card))
    _PartActions(page, slot, is_next_step=True)
    _ports(page, slot)
    _following(
        page, slot, lambda card: card.part_number, lambda card: manual_control_panel(page, slot, card.part_number)
    )
    heading(page.translate("Settings"))
    parameter_panel(page, slot)
    _following(page, slot, lambda card: card.part_number, partial(_wires, page))
    _rhythm(page, slot)
    _PartActions(page, slot)
    _why(page, slot)
    _log(page, slot)


def _following(page: Page, slot: str, key: Callable[[SlotCard], object], build: Callable[[SlotCard], None]) -> None:
    """Elements that depend on the part in the slot: made anew whenever their key is another one."""
    place = ui.column().classes("w-full")
    built: list[object] = []

    def show() -> None:
        card = page.service.views.slot(slot)
        if built == [wanted := key(card)]:
            return
        built[:] = [wanted]
        place.clear()
        with place:
            build(card)
        place.set_visibility(bool(place.default_slot.children))

    page.every_look(show, place)


def _simulator(page: Page, card: SlotCard) -> None:
    if card.simulated:
        simulator_panel(page, card.name)


def _state(page: Page, slot: str) -> None:
    shown = ui.html("", sanitize=False).classes("w-full")

    is_past = page.is_past

    def show() -> None:
        if page.is_past != is_past:
            return  # the drawer is being closed
        card = page.sight.slot(slot)
        part = card.part
        rows = [(page.translate("part number"), f"{card.shown_number} {page.translate(card.type_name)}".strip())]
        if part is not None:
            rows += [(page.translate("part"), part.part)]
            if page.may(Right.ARRANGE):  # knowing these lets somebody impersonate that part
                rows += [(page.translate("UID"), part.uid or "–")]
            if page.may(Right.ARRANGE) and not is_past:
                rows += [(page.translate("address"), part.address), (page.translate("session"), part.client_key)]
            versions = ((page.translate("hardware"), part.hardware), (page.translate("software"), part.software))
            rows += [(name, version) for name, version in versions if version]
            if part.home:
                rows.append((page.translate("runs on"), f"{page.translate(part.home)}, MsBOT {part.msbot}"))
            rows += [] if is_past else [(page.translate("beats"), f"{part.beats}")]
            rows += [
                (
                    page.translate("last beat"),
                    "–"
                    if part.beat_age_s is None
                    else page.translate("{age} s ago", age=page.number(part.beat_age_s, ".1f")),
                ),
            ]
            if part.plug_in_to_active_ms is not None:
                rows.append(
                    (page.translate("plug-in to active"), f"{page.number(part.plug_in_to_active_ms, '.1f')} ms")
                )
        if card.spares:
            rows.append((page.translate("standby"), ", ".join(card.spares)))
        chip = state_chip(card.state, page.translate(card.state))
        set_html(shown, render("slot_facts", say=page.translate, chip=chip, card=card, rows=rows))

    page.every_look(show, shown)


def _ports(page: Page, slot: str) -> None:
    heading(page.translate("Topics"))
    shown = ui.html("", sanitize=False).classes("w-full")

    is_past = page.is_past

    def show() -> None:
        ports = []
        for port in () if page.is_past != is_past else page.sight.slot(slot).ports:
            fields = done_fields(port)
            ports.append(
                {
                    "line": port,
                    "drawing": draw(port.type_name, fields, page.language),
                    "fields": fields_html(fields, page.language),
                    "held": page.translate(HELD_WORDS[port.held]) if port.held else "",
                }
            )
        set_html(
            shown,
            render(
                "slot_ports",
                say=page.translate,
                number=page.number,
                count=page.language.count,
                ports=ports,
                is_past=is_past,
            ),
        )

    page.every_look(show, shown)


def _wires(page: Page, card: SlotCard) -> None:
    """How such a part is wired to a Linux board, where a driver for it exists."""
    found = page.service.views.library.find(card.part_number)
    if found is not None and found.driver.entry_point:
        with ui.expansion(page.translate("Wiring"), icon="cable").classes("w-full"):
            ui.html(wiring_picture(found, say=page.translate), sanitize=False).classes("wiring w-full").props(
                "tabindex=0"
            )


def _rhythm(page: Page, slot: str) -> None:
    heading(page.translate("Time between beats"))
    shown = ui.html("", sanitize=False).classes("w-full")

    def show() -> None:
        intervals = page.service.views.beat_intervals(slot)
        words = (
            f"{page.number(min(intervals), '.2f')} – {page.number(max(intervals), '.2f')} s"
            if intervals
            else page.translate("no beats yet")
        )
        set_html(shown, render("rhythm", curve=sparkline(intervals, page.language, least=0.0), words=words))

    page.every_look(show, shown)


def _spares(page: Page) -> list[PartLine]:
    return [part for part in page.service.views.arrivals() if part.state == PartState.STANDBY.value and part.uid]


def _has_stand_in(page: Page, card: SlotCard) -> bool:
    return card.name in page.service.operations.stand_ins.names


class _PartAction(NamedTuple):
    """Something that can be done to the part in a slot."""

    words: str
    icon: str
    operation: str
    arguments: tuple[tuple[str, Any], ...]
    look: str = "outline"


class _PartActions:
    """The buttons for what can be done. Each stays the same one as long as it would do the same.

    A click takes its time to the server: for a button that had just been made anew it would be for nothing.

    Args:
        page: whose.
        slot: which.
        is_next_step: only what an empty slot needs, or one that a simulated part stands in for; otherwise all the rest.
    """

    def __init__(self, page: Page, slot: str, *, is_next_step: bool = False) -> None:
        self._page, self._slot, self._is_next_step = page, slot, is_next_step
        self._row = ui.element("div").classes("row")
        self._buttons: dict[_PartAction, ui.button] = {}
        page.every_look(self._show, self._row)

    def _show(self) -> None:
        card = self._page.service.views.slot(self._slot)
        # At the top of an empty slot, where it is looked for; beside a part it is one deed among others.
        first = "simulate" if card.part is None or _has_stand_in(self._page, card) else ""
        wanted = [one for one in self._wanted(card) if (one.operation == first) is self._is_next_step]
        for gone in self._buttons.keys() - set(wanted):
            self._buttons.pop(gone).delete()
        for at, deed in enumerate(wanted):
            if deed not in self._buttons:
                act = partial(self._page.act, deed.operation, **dict(deed.arguments))
                with self._row:
                    self._buttons[deed] = ui.button(deed.words, icon=deed.icon, on_click=act).props(deed.look)
                self._buttons[deed].move(target_index=at)
        self._row.set_visibility(bool(wanted))

    def _wanted(self, card: SlotCard) -> Iterator[_PartAction]:
        page, part, slot = self._page, card.part, ("slot", card.name)
        if part is not None and part.uid:
            uid = ("part", part.uid)
            if page.may_at(Right.OPERATE, card.name):
                named = uid if page.may(Right.ARRANGE) else ("part", card.name)
                yield _PartAction(page.translate("Identify"), "lightbulb", "identify", (named,))
            if page.may(Right.ARRANGE):
                yield _PartAction(page.translate("Release slot"), "eject", "release", (slot,))
                yield _PartAction(page.translate("Block part"), "block", "block", (uid,), "outline color=negative")
                known = page.service.views.library.find(part.part_number)
                is_here = PartState(part.state).is_registered
                if known is not None and known.origin and is_here and page.may(Right.DESIGN):
                    words = page.translate("Adopt anew")
                    yield _PartAction(words, "published_with_changes", "adopt", (uid, slot))
                if PartState(part.state).is_over:
                    yield _PartAction(page.translate("Forget part"), "delete_outline", "forget_part", (uid,))
                for spare in _spares(page):
                    words = page.translate("Swap to {part}", part=spare.part)
                    yield _PartAction(words, "swap_horiz", "swap", (slot, ("to", spare.uid)))
        # One click lets a simulated part stand in for that of the slot, another gives the slot back.
        stands_in = _has_stand_in(page, card)
        if page.may(Right.ARRANGE) and (stands_in or not card.simulated):
            words = page.translate("Give the slot back") if stands_in else page.translate("Simulate this slot")
            icon = "settings_backup_restore" if stands_in else "smart_toy"
            yield _PartAction(words, icon, "simulate", (slot, ("end", stands_in)))


def _why(page: Page, slot: str) -> None:
    heading(page.translate("Why?"))
    shown = ui.html("", sanitize=False).classes("why")
    last: list[Markup] = []

    def show() -> None:
        part = page.service.views.slot(slot).part
        lines = page.service.views.why(slot if part is None else part.part)
        content = render("lines", say=page.translate, lines=lines[:WHY_LINES])
        if not last:
            shown.set_content(content)
        elif last != [content]:  # not set_content: whoever is marking a sentence would lose it
            ui.run_javascript(f"msbotLines('{shown.html_id}', {json.dumps(content)})")
        last[:] = [content]

    page.every_look(show, shown)


def _log(page: Page, slot: str) -> None:
    """What the part's program logged last; nothing as long as it has logged nothing."""
    with ui.column().classes("w-full") as place:
        heading(page.translate("What its program says"))
        shown = ui.html("", sanitize=False).classes("log")

    def show() -> None:
        lines = page.service.views.log_lines(slot)
        place.set_visibility(bool(lines))
        set_html(shown, render("log_lines", say=page.translate, lines=reversed(lines)))

    page.every_look(show, place)
