"""A robot with a generic board: its own slot, one for each part that is wired to it, and a desk at all their ports."""

from __future__ import annotations

import asyncio
from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from msbot import Message
from msbot.config import Direction, Options, Slot, load_library, scalar_text
from msbot.part import Part
from msbot.part.join.pnp_messages import safe_setting
from msbot.pnp import Configuration, MemoryStore, SlotBinding
from msbot.sim import message_class
from tests.homes import runners
from tests.homes.world import PARTNER_SLOT, PARTNER_UID, SLOT, Robot, World

LIBRARY = load_library()
HERE = Path(__file__).parent
HOSTS = (HERE / "board_host.py",)
FAKES = ("machine=" + str(HERE / "fake_machine.py"), str(HERE / "board_host.py"))


class BoardHome(runners.MicroPython):
    """A generic board in an engine; `files` are what it has kept, `key` is the one in its `msbot.json`."""

    def __init__(
        self,
        engine: runners.Engine,
        link: str = "can",
        files: Mapping[str, str] | None = None,
        key: bytes | None = None,
    ) -> None:
        super().__init__(engine, link)
        self._files = dict(files or {})
        self._key = None if key is None else key.hex()

    def _first(self, program: str, name: str) -> dict[str, Any]:
        return {**super()._first(program, name), "do": "board", "files": self._files, "key": self._key}

    def machine(self, call: str, *given: object) -> Any:
        """Call a function of the world behind the pins."""
        return self._engine.ask({"do": "machine", "call": call, "with": list(given)})["is"]

    def files(self) -> dict[str, str]:
        """What the board keeps."""
        found: dict[str, str] = self._engine.ask({"do": "files"})["is"]
        return found

    def end(self) -> None:
        """Ctrl-C at the board."""
        self._take(self._engine.ask({"do": "end", "now": self._now()}))


class BoardWorld(World):
    """The robot: slot `mine` is the board's, the others are named in `parts`, slot to part number.

    With `keys`, UID to key, it is one that asks for keys; the desk has that of `PARTNER_UID`.
    """

    def __init__(
        self,
        home: BoardHome,
        parts: Mapping[str, str],
        wired: tuple[str, ...],
        keys: Mapping[bytes, bytes] | None = None,
        authentication: str = "key",
    ) -> None:
        options = Options() if keys is None else Options(authentication=authentication, explain=True)
        super().__init__(Robot(number="BOARD-8", options=options), home, "", "")
        self._keys = dict(keys or {})
        self.board = home
        self.parts = dict(parts)
        self.heard: dict[str, list[Message]] = {}
        slots = {SLOT: "BOARD-8", **parts}
        types = [LIBRARY.require(number) for number in dict.fromkeys(slots.values())]
        desk: list[SlotBinding] = []
        configurations = []
        for slot, number in slots.items():
            part_type = LIBRARY.require(number)
            bindings = tuple(
                SlotBinding(port.name, f"{slot}/{port.name}", port.type_name, port.direction is Direction.PUBLISH)
                for port in part_type.ports
            )
            desk += [replace(one, port=one.topic, publishes=not one.publishes) for one in bindings]
            settings = {one.name: scalar_text(one.default) for one in part_type.parameters}
            for port in part_type.ports:
                for field, value in (port.safe or {}).items():
                    settings[safe_setting(port.name, field)] = scalar_text(value)
            configurations.append(Configuration(1, slot, bindings, tuple(settings.items())))
        self.store = MemoryStore(
            types=(*types, replace(types[0], number="PARTNER", parameters=())),
            slots=(*(Slot(slot, number) for slot, number in slots.items()), Slot(PARTNER_SLOT, "PARTNER")),
            configurations=(*configurations, Configuration(1, PARTNER_SLOT, tuple(desk))),
        )
        self.store.keys.update(self._keys)
        self.wire(wired, tell=False)
        self.new_board_master()

    def new_board_master(self) -> None:
        """A master that knows the library."""
        self.master = self._make_master()
        self.master.library = LIBRARY

    def wire(self, texts: tuple[str, ...], *, tell: bool = True) -> None:
        """Somebody says what is wired to the board."""
        padded = (*texts, *[""] * (8 - len(texts)))
        self.change(SLOT, {f"part_{at}": text for at, text in enumerate(padded, 1)}, tell=tell)

    def change(self, slot: str, settings: Mapping[str, str], *, tell: bool = True) -> None:
        """Somebody changes settings of a slot."""
        old = self.store.configurations[slot]
        new = {**dict(old.settings), **settings}
        self.store.configurations[slot] = replace(old, version=old.version + 1, settings=tuple(new.items()))
        if tell:
            self.master.inventory.configuration_changed(slot)

    def plug_desk(self) -> None:
        """A part at the other ends of all ports."""

        def listen(part: Part) -> None:
            part.key = self._keys.get(PARTNER_UID)
            for binding in self.store.configurations[PARTNER_SLOT].bindings:
                if not binding.publishes:
                    part.on(binding.port, self._class(binding))(partial(self._hear, binding.port))

        self.plug_partner(listen)

    def send(self, port: str, **fields: Any) -> None:
        """The desk says something to a port, `SLOT/PORT`."""
        (binding,) = [one for one in self.store.configurations[PARTNER_SLOT].bindings if one.port == port]
        assert self.partner is not None
        assert self.partner.publish(port, self._class(binding)(**fields))

    def states(self) -> dict[str, str]:
        """The states of the parts, by slot."""
        now = asyncio.get_running_loop().time()
        return {info.slot or info.local_name: info.state.value for info in self.master.inventory.view(now)}

    async def until(self, seconds: float = 20.0, /, **wanted: str) -> None:
        """Wait until these slots have parts in these states."""
        loop = asyncio.get_running_loop()
        end_at = loop.time() + seconds
        while any(self.states().get(slot) != state for slot, state in wanted.items()):
            assert loop.time() < end_at, f"{self.states()}, not {wanted}; {self.log}"
            await asyncio.sleep(0.02)

    def _hear(self, port: str, message: Message) -> None:
        self.heard.setdefault(port, []).append(message)

    def _class(self, binding: SlotBinding) -> type[Message]:
        number = {SLOT: "BOARD-8", **self.parts}[binding.topic.partition("/")[0]]
        port = LIBRARY.require(number).port(binding.topic.partition("/")[2])
        assert port is not None
        assert port.message is not None
        return message_class(port.message)
