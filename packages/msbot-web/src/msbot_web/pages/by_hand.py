"""Driving a slot's ports by hand: a slider, a switch, a colour or a text for each port that hears something.

While the switch "by hand" is on the page holds the port and renews it; when the page is closed, nobody does, and the
port gets its safe value and follows its wire again (`msbot.operations.by_hand`).
"""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable, Mapping
from functools import partial

from nicegui import ui
from nicegui.events import ValueChangeEventArguments

from msbot.config import Direction, FieldKind, MessageType, Port, Scalar
from msbot.operations.rights import Right
from msbot_web.pages.layout import Page
from msbot_web.pages.number_field import NumberField

HELD_S = 3.0
"""A port is held for this long at a time."""
RENEW_S = 1.0
COLOUR = ["red", "green", "blue"]
RANGES = {"%": (-100.0, 100.0), "deg": (-180.0, 180.0), "Hz": (0.0, 5000.0), "1/min": (-600.0, 600.0), "s": (0.0, 60.0)}
"""What a slider offers, by the unit of the field."""


def hand_panel(page: Page, slot: str, part_number: str) -> None:
    """The controls for every port of a slot that can be driven; nothing when there is none, or no right to."""
    part_type = page.service.views.library.find(part_number) if part_number else None
    if part_type is None or not page.may(Right.OPERATE):
        return
    ports = [port for port in part_type.ports if port.direction is Direction.SUBSCRIBE and port.message is not None]
    if not ports:
        return
    with ui.element("div").classes("panel"):
        ui.label(page.say("Drive by hand")).props("role=heading aria-level=2").style("font-weight:650;font-size:1.1rem")
        ui.label(page.say("The wire is not heard meanwhile. Afterwards the port gets its safe value.")).classes("soft")
        for port in ports:
            assert port.message is not None
            _Lever(page, slot, port, port.message)


class _Lever:
    """One port, and what a person sets it to."""

    def __init__(self, page: Page, slot: str, port: Port, message: MessageType) -> None:
        self._page = page
        self._where = f"{slot}.{port.name}"
        self._values: dict[str, Scalar] = {name: kind.zero for name, kind in message.fields.items()}
        self._values |= dict(port.safe or {})
        self._saying = asyncio.Lock()
        """Values are sent one after the other, so that the last one set is the last one sent."""
        with ui.element("div").style("margin-top:.6rem;width:100%"):
            self._held = ui.switch(page.say("{port} by hand", port=port.name), on_change=self._switched)
            with ui.element("div").style("padding-left:1rem;width:100%") as self._fields:
                _fields(page, message, self._values, self._changed)
        self._fields.bind_visibility_from(self._held, "value")
        self._renewing = ui.timer(RENEW_S, self._say, active=False)
        assert page.client is not None
        page.client.on_disconnect(self._gone)

    @property
    def _is_held(self) -> bool:
        slot, _, port = self._where.rpartition(".")
        return (slot, port) in self._page.service.operations.by_hand.held()

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


Changed = Callable[[str, Scalar], Awaitable[None]]


def _fields(page: Page, message: MessageType, values: Mapping[str, Scalar], changed: Changed) -> None:
    """A control for each field; one for all three of a colour."""
    if list(message.fields) == COLOUR and all(kind is FieldKind.UINT8 for kind in message.fields.values()):
        _colour(page, values, changed)
        return
    for name, kind in message.fields.items():
        unit = message.units.get(name, "")
        title = f"{name} [{unit}]" if unit else name
        take = partial(_take, changed, name, kind)
        if kind is FieldKind.BOOL:
            ui.switch(title, value=bool(values[name]), on_change=take)
        elif kind is FieldKind.TEXT:
            ui.input(title, value=str(values[name]), on_change=take).props("debounce=300")
        elif unit in RANGES and not kind.is_whole:
            least, most = RANGES[unit]
            ui.label(title)
            step = (most - least) / 200
            slider = ui.slider(min=least, max=most, step=step, value=float(values[name]), on_change=take)
            slider.props("label debounce=100")
            slider.props["aria-label"] = title
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
    ui.color_input(page.say("Colour"), value=start, on_change=take)


async def _take(changed: Changed, name: str, kind: FieldKind, event: ValueChangeEventArguments[Scalar | None]) -> None:
    if event.value is None:
        return  # the field was emptied: the last value holds
    await changed(name, int(event.value) if kind.is_whole else event.value)


def _written(value: Scalar) -> str:
    return str(value).lower() if isinstance(value, bool) else str(value)
