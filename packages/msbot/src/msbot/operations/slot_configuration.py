"""The parameters of slots: setting them by hand, clearing them, showing them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial

from msbot.config import ParameterKind, SlotPort, board_documents, wired_parts
from msbot.operations.operation import Outcome, outcome_of
from msbot.operations.running_robot import ChangeableRobot, endpoint_of, slot_of
from msbot.registry import ValueRecord
from msbot.registry.edits import slot_values, wires
from msbot_agent.text.sentence import said
from msbot_agent.text.similar_names import instead_of
from msbot_xrce.errors import ConfigError


class SlotSettings:
    """Sets parameters by hand; parts of a running robot get them at once."""

    def __init__(self, robot: ChangeableRobot) -> None:
        self._robot = robot

    async def read(self, slot: str) -> tuple[ValueRecord, ...]:
        """The parameters of a slot, with values and where these come from.

        Raises:
            ConfigError: no such slot, or no database.
            RegistryError: the database cannot be read.
        """
        target = slot_of(self._robot, slot)
        return await self._robot.read(lambda registry, robot: registry.robots.values(robot, target))

    async def values(self, slot: str) -> Outcome:
        """The same, as JSON."""
        return Outcome(answer={"values": [_as_json(value) for value in await self.read(slot)]})

    async def set(self, slot: str, name: str, value: str | None, who: str) -> Outcome:
        """Set a parameter of a slot by hand; without a value, clear what was set by hand."""
        if value is None:
            return await self.reset(slot, name, who)
        target = slot_of(self._robot, slot)
        found = await self._find(target, name)
        wanted = found.read(value)
        if found.kind == ParameterKind.PART.value:
            await self._check_wired(target, {name: value})
        return outcome_of(
            await self._robot.change(who, partial(slot_values.set_value, slot=target, name=name, value=wanted))
        )

    async def _check_wired(self, slot: str, texts: Mapping[str, str]) -> None:
        """Check what is to be wired to a board, together with what is there already.

        Raises:
            ConfigError: it makes no sense, or a pin is taken.
        """
        library = self._robot.library
        if library is None:
            return
        wired = {one.name: str(one.value) for one in await self.read(slot) if one.kind == ParameterKind.PART.value}
        others = {other: there for other, there in wired.items() if other not in texts}
        board_documents(wired_parts({**others, **texts}, library))

    async def set_together(self, slot: str, values: Mapping[str, str | None], who: str) -> Outcome:
        """Set several parameters of a slot by hand, all or none; None clears what was set by hand."""
        target = slot_of(self._robot, slot)
        found = {name: await self._find(target, name) for name in values}
        wanted = {name: None if text is None else found[name].read(text) for name, text in values.items()}
        if not wanted:
            return Outcome()
        wires = {name: text for name, text in values.items() if found[name].kind == ParameterKind.PART.value and text}
        if wires:
            await self._check_wired(target, wires)
        return outcome_of(await self._robot.change(who, partial(slot_values.set_values, slot=target, values=wanted)))

    async def reset(self, slot: str, name: str, who: str) -> Outcome:
        """Clear what was set by hand; the value of blueprint or library holds again."""
        target = slot_of(self._robot, slot)
        found = await self._find(target, name)
        if found.origin != "hand":
            raise ConfigError(
                said(
                    "{name} of {target} is not set by hand: its value is the {origin}'s",
                    name=name,
                    target=target,
                    origin=said(found.origin),
                )
            )
        return outcome_of(
            await self._robot.change(who, partial(slot_values.set_value, slot=target, name=name, value=None))
        )

    async def _find(self, slot: str, name: str) -> ValueRecord:
        known = {value.name: value for value in await self.read(slot)}
        if name not in known:
            raise ConfigError(
                said(
                    "slot {slot} has no parameter {name!r}; {hint}",
                    slot=slot,
                    name=name,
                    hint=instead_of(name, known),
                )
            )
        return known[name]


def _as_json(value: ValueRecord) -> dict[str, object]:
    return {
        "name": value.name,
        "value": value.value,
        "unit": value.unit,
        "origin": value.origin,
        "who": value.who,
        "least": value.least,
        "most": value.most,
        "description": value.description,
    }


# Connects ports by topics, and disconnects them.


class Wires:
    """Connects ports, written `SLOT.port`; parts of a running robot follow at once."""

    def __init__(self, robot: ChangeableRobot) -> None:
        self._robot = robot

    async def bind(
        self,
        topic: str,
        type_name: str,
        source: str | None,
        targets: Sequence[str],
        *,
        reliable: bool,
        move: bool,
        who: str,
    ) -> Outcome:
        """Connect ports by a topic, in addition to those that it already connects."""
        start = None if source is None else endpoint_of(self._robot, source)
        ends = [endpoint_of(self._robot, target) for target in targets]
        making = partial(
            wires.bind, topic=topic, type_name=type_name, source=start, targets=ends, reliable=reliable, move=move
        )
        try:
            return outcome_of(await self._robot.change(who, making))
        except wires.NothingToChange as so:
            return Outcome(str(so))
        except ConfigError as error:
            slot = await self._adopted_without([*([] if start is None else [start]), *ends])
            if slot is None:
                raise
            words = said("{fault}; if its program has it now: msbot adopt {slot}", fault=error.args[0], slot=slot)
            raise ConfigError(words) from error

    async def _adopted_without(self, ends: Sequence[SlotPort]) -> str | None:
        """The slot of one of these ports whose part described itself, when it was adopted, without that port."""
        library = self._robot.library
        if library is None:
            return None
        blueprint = await self._robot.read(lambda registry, robot: registry.robots.blueprint(robot))
        numbers = {slot.name: slot.part_number for slot in blueprint.slots}
        for end in ends:
            part_type = library.get(numbers.get(end.slot, ""))
            if part_type is not None and part_type.origin and part_type.port(end.port) is None:
                return end.slot
        return None

    async def unbind(self, topic: str, port: str | None, who: str) -> Outcome:
        """Disconnect a port, or all ports, from a topic."""
        end = None if port is None else endpoint_of(self._robot, port)
        return outcome_of(await self._robot.change(who, partial(wires.unbind, topic=topic, endpoint=end)))
