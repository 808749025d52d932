"""Parts that describe themselves: what they say is checked, and adopted when a person says so."""

from __future__ import annotations

import asyncio
import contextlib
import re
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TypeVar, cast

from msbot.config import (
    ADOPTED,
    Blueprint,
    Described,
    Direction,
    Library,
    MessageType,
    PartType,
    Port,
    Slot,
    SlotPort,
    read_description,
    substitute,
)
from msbot.operations.apply_blueprint import BlueprintChange
from msbot.operations.operation import Outcome
from msbot.operations.running_robot import RunningRobot, slot_of
from msbot.pnp import PartInfo, SelfDescription
from msbot.process.daemon_threads import DaemonThreads
from msbot.registry.edits.part_places import forget_part_type
from msbot.registry.edits.wires import unbind
from msbot_agent.process.user_folders import replace_file
from msbot_agent.text.sentence import joined, said
from msbot_agent.toml.table import MOST_OCTETS, toml_value
from msbot_xrce.errors import ConfigError, MsbotError
from msbot_xrce.lazy import dataclass

# Which wires would fit a slot by the types of its ports: offered to a person, never made without one.


MOST_OFFERED = 24
_GIVING = (Direction.PUBLISH, Direction.SERVE)


@dataclass(frozen=True, slots=True)
class FittingWire:
    """One wire that could be made, in the words of the operation `bind`."""

    topic: str
    type_name: str
    source: SlotPort
    target: SlotPort | None
    """None: only people look at it, or call it."""

    def as_json(self) -> dict[str, object]:
        """The arguments of `bind`."""
        to = [] if self.target is None else [str(self.target)]
        return {"topic": self.topic, "type": self.type_name, "from": str(self.source), "to": to}


def fitting_wires(blueprint: Blueprint, library: Library, slot: str) -> list[FittingWire]:
    """Wires between the unwired ports of a slot and ports of other slots that carry the same message type.

    Where the other port has a topic already, the wire joins it.
    """
    topics = {end: binding.topic for binding in blueprint.bindings for end in binding.ends}
    ports = list(_ports(blueprint, library))
    own = [(end, port) for end, port in ports if end.slot == slot and end not in topics]
    others = [(end, port) for end, port in ports if end.slot != slot]
    return list(_fitting(own, others, topics))[:MOST_OFFERED]


def wires_for_people(blueprint: Blueprint, library: Library, slot: str) -> list[FittingWire]:
    """Wires with nobody at their ends, for the unwired ports of a slot that publish or serve: people look and call."""
    wired = {end for binding in blueprint.bindings for end in binding.ends}
    ports = [(end, port) for end, port in _ports(blueprint, library) if end.slot == slot and end not in wired]
    return [
        FittingWire(free_topic_name(blueprint, end), port.type_name, end, None)
        for end, port in ports
        if port.direction in _GIVING
    ][:MOST_OFFERED]


def wires_to_send_by_hand(blueprint: Blueprint, library: Library, slot: str) -> list[dict[str, Sequence[str]]]:
    """Wires to the unwired ports of a slot that hear something, from nobody yet, as the arguments of `bind`."""
    wired = {end for binding in blueprint.bindings for end in binding.ends}
    return [
        {"topic": free_topic_name(blueprint, end), "type": port.type_name, "from": "", "to": [str(end)]}
        for end, port in _ports(blueprint, library)
        if end.slot == slot and end not in wired and port.direction is Direction.SUBSCRIBE
    ][:MOST_OFFERED]


def free_topic_name(blueprint: Blueprint, end: SlotPort) -> str:
    """A name for a topic of a port that no other topic has."""
    taken = {binding.topic for binding in blueprint.bindings}
    names = [end.port, f"{end.slot}_{end.port}", *(f"{end.slot}_{end.port}_{n}" for n in range(2, len(taken) + 3))]
    return next(name for name in names if name not in taken)


def _ports(blueprint: Blueprint, library: Library) -> Iterator[tuple[SlotPort, Port]]:
    for slot in blueprint.slots:
        part_type = library.get(slot.part_number)
        for port in () if part_type is None else part_type.ports:
            yield SlotPort(slot.name, port.name), port


def _fitting(
    own: list[tuple[SlotPort, Port]], others: list[tuple[SlotPort, Port]], topics: Mapping[SlotPort, str]
) -> Iterator[FittingWire]:
    for end, port in own:
        for other, their in others:
            if their.type_name == port.type_name and their.direction is not port.direction:
                if port.direction is Direction.SERVE and other in topics:
                    continue  # what it calls is served by another part
                source, target = (end, other) if port.direction in _GIVING else (other, end)
                topic = topics.get(other) or f"{source.slot}_{source.port}"
                yield FittingWire(topic, port.type_name, source, target)


@dataclass(frozen=True, slots=True)
class ChangedPort:
    """A port that is on a topic, and that its part does not have any more as it was."""

    topic: str
    end: SlotPort
    words: str
    """The port, and what has changed."""


def ports_that_changed(blueprint: Blueprint, number: str, now: PartType) -> list[ChangedPort]:
    """The ports of the slots of a part number that cannot stay on their topics, because the type is another one now."""
    slots = {slot.name for slot in blueprint.slots if slot.part_number == number}
    found = []
    for binding in blueprint.bindings:
        for end in binding.ends:
            port = now.port(end.port)
            gives = end == binding.source
            if end.slot not in slots:
                continue
            if port is None:
                words = said("{end} (topic {topic}: the port is gone)", end=str(end), topic=binding.topic)
            elif port.type_name != binding.type_name:
                words = said(
                    "{end} (topic {topic}: it carries {type} now)",
                    end=str(end),
                    topic=binding.topic,
                    type=port.type_name,
                )
            elif (port.direction in _GIVING) is not gives:
                words = said("{end} (topic {topic}: it has the other direction now)", end=str(end), topic=binding.topic)
            else:
                continue
            found.append(ChangedPort(binding.topic, end, words))
    return found


ASK_TIMES = 3
ASK_AGAIN_S = 1.0
"""How often a part that is adopted anew is asked what it is, and the time between."""
LONGEST_FAULT = 600
"""Characters of the reason why a description is refused."""
LONGEST_NAME = 40
MOST_ALIKE = 100
"""Files of one name that are told apart by a number."""
_UNSAFE = re.compile(r"[^A-Za-z0-9_.-]+")
_T = TypeVar("_T")


class DescribedPartAdoption:
    """Checks what the parts of one running robot say of themselves, and adopts them.

    Args:
        running: the robot.
        applying: how it gets another slot.
    """

    def __init__(self, running: RunningRobot, applying: BlueprintChange) -> None:
        self._running = running
        self._applying = applying
        source = running.master.blueprint.source
        self._folder = None if source is None else source.parent / ADOPTED
        self._aside = DaemonThreads(1, "msbot descriptions")  # the event loop waits for no parser and no disk
        self._asked_again: dict[int, asyncio.Future[SelfDescription]] = {}
        """By client key: what a part says that is adopted anew."""
        running.inventory.descriptions.on_described(self._check_soon)

    def _check_soon(self, client_key: int, number: str, asked: SelfDescription) -> None:
        waiting = self._asked_again.get(client_key)
        if waiting is not None:
            if not waiting.done():
                waiting.set_result(asked)
            return
        self._running.run_later(self._check(client_key, number, asked))

    async def _check(self, client_key: int, number: str, asked: SelfDescription) -> None:
        try:
            result = replace(asked, described=await self._read(asked.text, number))
        except ConfigError as error:
            words = " ".join(str(error).split())
            result = replace(asked, fault=words if len(words) <= LONGEST_FAULT else f"{words[:LONGEST_FAULT]} ...")
        self._running.inventory.descriptions.checked(client_key, asked, result, self._running.now())

    async def _read(self, text: str, number: str, library: Library | None = None) -> Described:
        library = library or self._running.library
        if library is None:
            raise ConfigError(said("this robot was started without its library: it cannot take part types"))
        return await asyncio.get_running_loop().run_in_executor(self._aside, read_description, text, number, library)

    async def make_type(self, info: PartInfo, slot: str | None, who: str) -> Outcome:
        """Make a part type of what a part says, and a slot for it, and let it in.

        Args:
            info: the part; it says what it is.
            slot: the name of its slot; None: one is made from its own name.
            who: the person who decides.

        Raises:
            ConfigError: what it says is refused, or there is nowhere to keep it.
            RegistryError: it cannot be stored; nothing has changed.
        """
        assert info.says is not None
        described = await self._read(info.says.text, info.part_number)  # the library may know more by now
        present = await self._applying.present()
        taken = set(self._running.slot_names())
        name = free_slot_name(info, described, taken) if slot is None else slot
        check_slot_name(name)
        origin = said("said by the part {uid}, adopted by {who}", uid=info.uid.hex() or "-", who=who)
        path = await self._in_thread(partial(self._keep, described, origin))
        part_type = replace(described.part_type, origin=origin, source="" if path is None else str(path))
        library = self._running.library
        assert library is not None
        wider = library.with_type(part_type, described.messages)
        wanted = replace(present, slots=(*present.slots, Slot(name, part_type.number, description=part_type.name)))
        try:
            done = await self._applying.put_in_force(wanted, wider, who=who, slot_by_hand=name)
        except MsbotError:
            if path is not None:
                await self._in_thread(path.unlink)
            raise
        self._let_in(info, name, who)
        words = said(
            "{number} ({name}) is in the library now, as the part describes it, and has slot {slot}",
            number=part_type.number,
            name=part_type.name,
            slot=name,
        )
        if part_type.name == part_type.number:
            words = said(
                "{number} is in the library now, as the part describes it, and has slot {slot}",
                number=part_type.number,
                slot=name,
            )
        return Outcome(words, done.edit_id, {"slot": name, **await self._wires_to_make(name, library)})

    async def _wires_to_make(self, name: str, library: Library) -> dict[str, object]:
        """The wires that can be made for a slot, as arguments of `bind`: with other slots, for people, and by hand."""
        blueprint = await self._in_force()
        offers = [wire.as_json() for wire in fitting_wires(blueprint, library, name)]
        offered = {wire["from"] for wire in offers}
        alone = [wire.as_json() for wire in wires_for_people(blueprint, library, name)]
        for_people = [wire for wire in alone if wire["from"] not in offered]
        fed = {end for wire in offers for end in cast("list[str]", wire["to"])}
        by_hand = [wire for wire in wires_to_send_by_hand(blueprint, library, name) if fed.isdisjoint(wire["to"])]
        return {"offers": offers, "for_people": for_people, "by_hand": by_hand}

    def has_described(self, info: PartInfo) -> bool:
        """Whether the library has the type of a part from its own description."""
        library = self._running.library
        known = None if library is None else library.find(info.part_number)
        return known is not None and bool(known.origin)

    async def adopt_anew(self, info: PartInfo, slot: str, who: str) -> Outcome:
        """Take what a part says of itself now, in place of what it said when it was adopted.

        Wires stay at ports that are as before; the other ports are taken off their topics, and named.

        Args:
            info: the part, which is in the robot; its type was adopted.
            slot: its slot.
            who: the person who decides.

        Raises:
            ConfigError: it says nothing, or the same as before, or what it says is refused.
            RegistryError: it cannot be stored.
        """
        library = self._running.library
        assert library is not None
        old = library.require(info.part_number)
        path = self._file_of(old)
        others = library.without_type(old.number)
        described = await self._read(await self._say_again(info, slot, old.number), info.part_number, others)
        if _is_same(old, described, library):
            words = said(
                "{part} is in slot {target} already, and describes itself as before", part=info.part, target=slot
            )
            raise ConfigError(words)
        registry, robot = self._running.database()
        blueprint = await self._in_force()
        lost = ports_that_changed(blueprint, old.number, described.part_type)
        for one in lost:
            await registry.edits.make_soon(robot, who, partial(unbind, topic=one.topic, endpoint=one.end))
        origin = said("said by the part {uid}, adopted by {who}", uid=info.uid.hex() or "-", who=who)
        before = None if path is None else await self._in_thread(partial(path.read_text, "utf-8"))
        if path is not None:
            await self._in_thread(partial(_write, path, described, origin))
        made = replace(described.part_type, origin=origin, source=old.source)
        wider = others.with_type(made, described.messages)
        try:
            await self._applying.put_in_force(await self._applying.present(), wider, who=who)
        except MsbotError:
            if path is not None and before is not None:
                await self._in_thread(partial(replace_file, path, before.encode()))
            raise
        words = said("{number} is in the library now as its part describes it; its wires stay", number=made.number)
        if lost:
            words = said(
                "{number} is in the library now as its part describes it; its wires stay, but for {lost}",
                number=made.number,
                lost=joined(", ", [one.words for one in lost]),
            )
        answer: dict[str, object] = {"slot": slot, "lost": [{"topic": one.topic, "port": str(one.end)} for one in lost]}
        return Outcome(words, answer=answer | await self._wires_to_make(slot, wider))  # undo brings no type back

    def _file_of(self, part_type: PartType) -> Path | None:
        """The library file of a type that was adopted; None: it has none."""
        path = Path(part_type.source) if part_type.source else None
        if path is not None and path.parent != self._folder:
            raise ConfigError(
                said(
                    "{number} was adopted by another robot: change its library file {file}",
                    number=part_type.number,
                    file=str(path),
                )
            )
        return path

    async def _say_again(self, info: PartInfo, slot: str, number: str) -> str:
        """What a part that is in the robot says of itself."""
        waiting: asyncio.Future[SelfDescription] = asyncio.get_running_loop().create_future()
        self._asked_again[info.client_key] = waiting
        service = self._running.master.inventory_service
        try:
            for _ in range(ASK_TIMES):  # a question may be lost
                if not self._running.inventory.descriptions.ask_again(info.client_key):
                    break
                service.ask_what(info.client_key)
                with contextlib.suppress(TimeoutError):
                    says = await asyncio.wait_for(asyncio.shield(waiting), ASK_AGAIN_S)
                    if says.fault:
                        raise ConfigError(
                            said("what {part} says of itself is refused: {fault}", part=info.part, fault=says.fault)
                        )
                    return says.text
        finally:
            del self._asked_again[info.client_key]
        raise ConfigError(
            said(
                "{part} does not say what it is: run its program with describes=, under this version of MsBOT; or call "
                "msbot slot remove {slot}, msbot library forget {number}, msbot adopt {number}",
                part=info.part,
                slot=slot,
                number=number,
            )
        )

    def _let_in(self, info: PartInfo, slot: str, who: str) -> None:
        """Give the part its slot at once; one that has begun to claim again gets it by its number."""
        inventory, now = self._running.inventory, self._running.now()
        waits = any(
            one.client_key == info.client_key and one.uid == info.uid and not one.state.is_registered
            for one in inventory.view(now)
            if not one.state.is_over
        )
        if waits:
            reason = said("{who} adopted it into slot {target}", who=who, target=slot)
            with contextlib.suppress(MsbotError):  # it is being checked this moment, and its number is known now
                inventory.rearrange({info.client_key: slot}, now, reason)

    async def spare(self, slot: str, part: str, agreed: bool, who: str) -> Outcome:
        """Let a part of another kind stand by for a slot; refused as long as something is lost and nobody agrees.

        Args:
            slot: the slot.
            part: the part; it says what it is, or was adopted before.
            agreed: the person knows what is lost.
            who: the person who decides.

        Raises:
            ConfigError: it cannot fill the slot, or something is lost; the text says what.
            RegistryError: it cannot be stored; nothing has changed.
        """
        running, library = self._running, self._running.library
        target = slot_of(running, slot)
        info = running.part(part, prefer=lambda one: not one.state.is_registered)
        if library is None:
            raise ConfigError(said("this robot was started without its library: it cannot take part types"))
        blueprint = await self._in_force()
        place = next(one for one in blueprint.slots if one.name == target)
        old, new = library.require(place.part_number), await self._type_of(info, library)
        if place.part_number in (new.number, *new.compatible_with):
            raise ConfigError(said("{part} fits slot {slot} already", part=info.part, slot=target))
        wired = {end.port for binding in blueprint.bindings for end in binding.ends if end.slot == target}
        lost = substitute(old, new, wired, place.settings)
        names = {"part": info.part, "number": new.number, "slot": target}
        if lost.wired:
            ports = ", ".join(lost.wired)
            words = said("{part} ({number}) cannot fill slot {slot}: its ports {ports} are wired", **names, ports=ports)
            raise ConfigError(said("{words}, and the part has none of that name, direction and message", words=words))
        if lost.words and not agreed:
            words = said("if {part} ({number}) fills slot {slot}, this is lost: {lost}", **names, lost=lost.words)
            raise ConfigError(said("{words}; if that is right, say so: --agreed", words=words))
        lacks = tuple(dict.fromkeys((*new.lacks, *lost.ports)))
        made = replace(new, compatible_with=(*new.compatible_with, old.number), lacks=lacks)
        await self._use_type(made, info, who)
        words = said("{part} ({number}) fits slot {slot} from now on, and stands by for it", **names)
        return Outcome(said("{words}; lost is {lost}", words=words, lost=lost.words) if lost.words else words)

    async def _type_of(self, info: PartInfo, library: Library) -> PartType:
        """What a part is: as it says, or as it was adopted."""
        if (known := library.get(info.part_number)) is not None:
            if not known.origin:
                raise ConfigError(
                    said(
                        "{number} was not adopted: write compatible_with into its library file {file}",
                        number=known.number,
                        file=known.source,
                    )
                )
            return known
        if info.says is None or info.says.fault:
            fault = said("nothing") if info.says is None else info.says.fault
            raise ConfigError(said("what {part} says of itself is refused: {fault}", part=info.part, fault=fault))
        return (await self._read(info.says.text, info.part_number)).part_type

    async def _use_type(self, made: PartType, info: PartInfo, who: str) -> None:
        """Keep a part type that fits other slots, and use it; its file is written anew or changed."""
        library = self._running.library
        assert library is not None
        messages: tuple[MessageType, ...] = ()
        path: Path | None = Path(made.source)
        if made.origin and (path is None or path.parent != self._folder):
            path = None  # it is forgotten when the master ends
        elif not made.origin:
            assert info.says is not None
            described = await self._read(info.says.text, info.part_number)
            messages = described.messages
            origin = said("said by the part {uid}, adopted by {who}", uid=info.uid.hex() or "-", who=who)
            path = await self._in_thread(partial(self._keep, described, origin))
            made = replace(made, origin=origin, source="" if path is None else str(path))
        if path is not None:
            await self._in_thread(partial(_write_fit, path, made))
        await self._applying.put_in_force(await self._applying.present(), library.with_type(made, messages), who=who)

    async def forget_type(self, number: str, who: str) -> Outcome:
        """Take a part type that was adopted out of the library again; then a part may describe it anew."""
        library = self._running.library
        part_type = None if library is None else library.get(number)
        if library is None or part_type is None:
            raise ConfigError(said("the library has no part number {number}", number=number))
        if not part_type.origin:
            raise ConfigError(
                said("{number} was not adopted: its library file is {file}", number=number, file=part_type.source)
            )
        blueprint = await self._in_force()
        if slots := [slot.name for slot in blueprint.slots if slot.part_number == number]:
            raise ConfigError(
                said("{number} has slots: {slots}; take them out first", number=number, slots=", ".join(slots))
            )
        registry, robot = self._running.database()
        edit = await registry.edits.make_soon(robot, who, partial(forget_part_type, number=number))
        library.become(library.without_type(number))
        if part_type.source and Path(part_type.source).parent == self._folder:
            await self._in_thread(partial(Path(part_type.source).unlink, missing_ok=True))
        return Outcome(edit.words)

    async def _in_force(self) -> Blueprint:
        """The blueprint in force, with what people set by hand."""
        registry, robot = self._running.database()
        return await registry.storage.in_time(registry.robots.blueprint, robot)

    async def _in_thread(self, do: Callable[[], _T]) -> _T:
        try:
            return await asyncio.get_running_loop().run_in_executor(self._aside, do)
        except OSError as error:
            raise ConfigError(
                said("the library folder {folder} cannot be written: {why}", folder=str(self._folder), why=str(error))
            ) from error

    def _keep(self, described: Described, origin: str) -> Path | None:
        """Write the library file; None: the robot has no folder, so the type is forgotten when the master ends."""
        if self._folder is None:
            return None
        self._folder.mkdir(exist_ok=True)
        stem = _UNSAFE.sub("_", described.part_type.number)[:LONGEST_NAME].lstrip(".") or "part"
        names = (stem, *(f"{stem}-{number}" for number in range(2, MOST_ALIKE)))
        path = next((path for name in names if not (path := self._folder / f"{name}.toml").exists()), None)
        if path is None:
            raise OSError(f"{MOST_ALIKE} files are called {stem}")
        return _write(path, described, origin)


def _write(path: Path, described: Described, origin: str) -> Path:
    """Write a library file: one that is half written must not keep the next master from starting."""
    replace_file(path, f"origin = {toml_value(origin)}\n{described.toml}".encode())
    return path


def _is_same(old: PartType, described: Described, library: Library) -> bool:
    """Whether a part describes itself as it did when it was adopted."""
    bare = replace(old, origin="", compatible_with=(), lacks=(), source=described.part_type.source)
    told = {one.name: one.described() for one in described.messages}
    known = {name: library.messages[name].described() for name in told if name in library.messages}
    return bare == described.part_type and told == known


def _write_fit(path: Path, made: PartType) -> None:
    """Write into a library file that was adopted whose slots its parts fill as well."""
    lines = [
        line for line in path.read_text("utf-8").splitlines() if not line.startswith(("compatible_with = ", "lacks = "))
    ]
    fits = [f"compatible_with = [{', '.join(toml_value(one) for one in made.compatible_with)}]"]
    fits += [f"lacks = [{', '.join(toml_value(one) for one in made.lacks)}]"] if made.lacks else []
    replace_file(path, ("\n".join([*fits, *lines]) + "\n").encode())


def free_slot_name(info: PartInfo, described: Described, taken: Collection[str]) -> str:
    """A name for the slot of a part: after its local name if it has one, else after its part number."""
    own = info.local_name if info.local_name != info.part_number else described.part_type.number
    stem = "_".join(re.findall(r"\w+", own.lower()))[:LONGEST_NAME] or "part"
    return next(name for name in (stem, *(f"{stem}_{n}" for n in range(2, len(taken) + 3))) if name not in taken)


def check_slot_name(name: str) -> None:
    """Check the name that a person gives to a slot.

    Raises:
        ConfigError: it is empty, too long, or has characters that no slot's name has.
    """
    if not name or name != name.strip() or not name.isprintable() or "." in name or len(name.encode()) > MOST_OCTETS:
        raise ConfigError(said("{name!r} is no name for a slot: letters, digits and _, without a dot", name=name[:60]))
