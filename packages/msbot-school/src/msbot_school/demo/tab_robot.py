"""The sample robot of the docs' page "Try it in this tab": a whole robot in a browser, without a server.

Python runs there as WebAssembly (Pyodide). Master, agent, parts and the simulated bus are those of `msbot demo`; what
the tab lacks is replaced by what MsBOT has for tests and small robots: `MemoryStore` in place of the database,
`HostedLoop` in place of a loop that waits for sockets. The page sends commands as JSON and is told how the robot is as
JSON; it knows nothing of the robot by itself.
"""

from __future__ import annotations

import asyncio
import json
import logging
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import asdict
from itertools import islice
from random import Random
from typing import Any

from msbot.config import Blueprint, Direction, Library, PartType, Port, Scalar, load_library, scalar_text
from msbot.config.blueprint.blueprint_file_reader import parse_blueprint
from msbot.part import Part
from msbot.part.join.pnp_messages import safe_setting
from msbot.part.messages.standard import Level, Switch
from msbot.part.program_mistakes import sentence
from msbot.pnp import KNOWN_TYPES, Configuration, FrameListener, MemoryStore, PartEvent, SessionListener, SlotBinding
from msbot.sim import SimulatedPart
from msbot_agent.link.can.protocol import Frame, show_frame
from msbot_school.demo.demo_links import DemoStateChange
from msbot_school.demo.demo_robot import DemoRobot
from msbot_xrce.errors import ConfigError, MsbotError

ROBOT_TOML = """\
[robot]
name = "TAB"
version = "TAB_V1"
serial_number = "T-0001"
released = "2026"
manufacturer = "MsBOT"

[timing]
beat_period_s = 0.5
tick_period_s = 1.0

[options]
explain = true

[[slot]]
name = "knob"
part = "POT-10K"

[[slot]]
name = "fan"
part = "FAN-5V"

[[slot]]
name = "lamp"
part = "LED"

[[slot]]
name = "yours"
part = "YOURS"

[[binding]]
topic = "knob_level"
type = "Level"
from = "knob.level"
to = ["fan.power", "yours.knob"]

[[binding]]
topic = "lamp_on"
type = "Switch"
from = "yours.light"
to = ["lamp.on"]
"""
YOURS = "yours"
SPARES = {"spare fan": "fan"}
FILE = "yours.py"
HEAD = """\
from msbot import Level, Part, Switch

part = Part("YOURS", local_name="yours")

"""
"""What stands above a visitor's lines."""
FIRST_LINES = """\
@part.on("knob", Level)
def light(level):
    part.publish("light", Switch(on=level.percent > 50))
"""
TAIL = "\npart.run()\n"
"""What stands below them, and is left to the tab, which has the part join on its own bus."""
MOST_OCTETS = 20_000
"""Of a visitor's program."""
LOOK_S = 0.25
"""Period in which the page is told how the robot is."""
FRAMES = 14
EVENTS = 12
LINES = 60
"""How many of the newest frames, changes and lines of the visitor's program the page shows."""
DECODED = 400
"""Most frames between two looks that are put into words; of what is more, only the number is shown."""
VISITOR = "you"


def tab_library() -> Library:
    """MsBOT's part types, and the one of the visitor's part."""
    library = load_library()
    ports = (
        Port("knob", Direction.SUBSCRIBE, "Level", message=library.messages["Level"]),
        Port("light", Direction.PUBLISH, "Switch", message=library.messages["Switch"]),
    )
    return library.with_type(PartType("YOURS", "A part of your own", ports=ports))


def memory_of(blueprint: Blueprint, library: Library) -> MemoryStore:
    """What a database would hold of a new robot: slots, wires, settings and safe values."""
    return _TabMemory(
        types=tuple(library),
        slots=blueprint.slots,
        configurations=tuple(_configuration(blueprint, library, slot.name) for slot in blueprint.slots),
    )


class _TabMemory(MemoryStore):
    """Nobody reads its journal: the page shows each change when it happens."""

    def journal(self, event: PartEvent) -> None:
        """Keep nothing."""


def _configuration(blueprint: Blueprint, library: Library, name: str) -> Configuration:
    slot = blueprint.slot(name)
    assert slot is not None
    part_type = library.require(slot.part_number)
    bindings = tuple(
        SlotBinding(end.port, one.topic, one.type_name, publishes=end is one.source, reliable=one.reliable)
        for one in blueprint.bindings
        for end in one.ends
        if end.slot == name
    )
    values = {one.name: one.default for one in part_type.parameters} | dict(slot.settings)
    bound = {one.port for one in bindings if not one.publishes}
    for port in part_type.ports:
        if port.name in bound or port.name in slot.safe:
            values |= {safe_setting(port.name, field): value for field, value in slot.safe_at(port).items()}
    return Configuration(1, name, bindings, tuple(sorted((key, scalar_text(value)) for key, value in values.items())))


class TabRobot:
    """The robot of one tab. Must be made inside its running event loop.

    Args:
        tell: called with a JSON text whenever the page should show something else.
        random: the source of everything random; a seeded one makes a run in virtual time repeatable.
    """

    def __init__(self, tell: Callable[[str], object], random: Random | None = None) -> None:
        self._tell = tell
        library = tab_library()
        blueprint = parse_blueprint(ROBOT_TOML, library)
        self.robot = DemoRobot(
            blueprint,
            memory_of(blueprint, library),
            spares=SPARES,
            unplugged=(YOURS,),
            library=library,
            random=random,
        )
        self.robot.on_frame(self._frame)
        self.robot.on_event(self._changed)
        listener = SessionListener((*KNOWN_TYPES, Level, Switch), units=library.units)
        self._words = FrameListener(listener)
        self._frames: deque[tuple[int, float, str, Frame]] = deque(maxlen=DECODED)
        """Those that came since the last look."""
        self._frame_count = 0
        self._shown: deque[dict[str, object]] = deque(maxlen=FRAMES)
        self._events: deque[DemoStateChange] = deque(maxlen=EVENTS)
        self._event_count = 0
        self._reasons: dict[str, str] = {}
        """Place -> why its part is in its state."""
        self._said: deque[str] = deque(maxlen=LINES)
        """What the visitor's program has printed, and what is wrong with it."""
        self._answer = ""
        """What is wrong with the visitor's last command; empty: nothing."""

    async def run(self) -> None:
        """Run the robot until cancelled, and tell the page how it is."""
        logger, errors = logging.getLogger("msbot.part"), _ProgramErrors(self._said.append)
        logger.addHandler(errors)
        try:
            async with asyncio.TaskGroup() as tasks:
                tasks.create_task(self.robot.run())
                while True:
                    self._tell(self.look())
                    await asyncio.sleep(LOOK_S)
        finally:
            logger.removeHandler(errors)

    # What the page says

    def act(self, command: str) -> None:
        """Do what the visitor wants: a JSON text such as `{"do": "pull", "place": "fan"}`."""
        self._answer = ""
        try:
            self._act(json.loads(command))
        except MsbotError as error:
            self._answer = str(error)
        self._tell(self.look())

    def _act(self, command: Mapping[str, Any]) -> None:
        match command:
            case {"do": "pull", "place": str(place)}:
                self.robot.unplug(place)
            case {"do": "plug", "place": str(place)}:
                self.robot.plug(place)
            case {
                "do": "set",
                "place": str(place),
                "control": str(control),
                "value": bool() | float() | int() | str() as value,
            }:
                self._set(place, control, value)
            case {"do": "stop"}:
                self.robot.master.say_stop(VISITOR)
            case {"do": "go"}:
                self.robot.master.say_go(VISITOR)
            case {"do": "run", "lines": str(lines)}:
                self._run_program(lines)
            case _:
                raise ConfigError(f"the page said {json.dumps(command)}, which the robot does not understand")

    def _set(self, place: str, control: str, value: Scalar) -> None:
        unit = self.robot.simulated(place)
        if unit is None:
            raise ConfigError(f"{place} is not plugged in")
        unit.set(control, value)

    # The visitor's program

    def _run_program(self, lines: str) -> None:
        self.robot.unplug(YOURS)
        self._said.clear()
        if len(lines.encode()) > MOST_OCTETS:
            raise ConfigError(f"a program for this page has at most {MOST_OCTETS} octets")
        try:
            part = self._part_of(HEAD + lines)
        except SyntaxError as error:
            self._said.append(f"{FILE}:{error.lineno}: {error.msg}")
            return
        except Exception as error:
            self._said.append(_words(error))
            return
        self.robot.plug_program(YOURS, part, self._ended)

    def _part_of(self, text: str) -> Part:
        space: dict[str, object] = {"__name__": "yours", "print": self._print}
        exec(compile(text, FILE, "exec"), space)  # noqa: S102 - the visitor's own program, in the visitor's own tab
        part = space.get("part")
        if not isinstance(part, Part):
            raise ConfigError(f"{FILE}: the name `part` must stay the part of the first lines")
        if part.program.calls:
            raise ConfigError(
                f"{FILE}: part.calls: nobody in this robot answers, and a function cannot wait for a reply in a tab; "
                "on a computer it can"
            )
        return part

    def _print(self, *values: object, sep: str | None = None, end: str | None = None, **_: object) -> None:
        text = (" " if sep is None else sep).join(map(str, values)) + ("" if end is None else end)
        self._said.extend(text.rstrip("\n").splitlines() or [""])

    def _ended(self, error: Exception) -> None:
        self._said.append(_words(error))

    # What the page is told

    def _frame(self, at: float, sender: str, frame: Frame) -> None:
        self._frame_count += 1
        self._frames.append((self._frame_count, at, sender, frame))

    def _changed(self, event: DemoStateChange) -> None:
        self._event_count += 1
        self._events.append(event)
        self._reasons[event.part] = event.reason

    def look(self) -> str:
        """How the robot is now."""
        robot = self.robot
        snapshot = robot.snapshot()
        self._decode()
        stop = robot.master.stop
        return json.dumps(
            {
                "robot": snapshot.robot,
                "at_s": snapshot.at_s,
                "parts": [self._part(asdict(part)) for part in snapshot.parts],
                "bus": None if snapshot.bus is None else asdict(snapshot.bus),
                "topics": [asdict(topic) for topic in snapshot.topics],
                "stop": {
                    "stopped": stop.stopped,
                    "by": stop.by,
                    "confirmed": [asdict(one) for one in stop.confirmed],
                    "silent": stop.silent,
                },
                "events": [{**asdict(one), "number": n} for n, one in self._numbered()],
                "frames": list(self._shown),
                "program": [*self._said],
                # What its part has logged, as the master heard it.
                "log": [one.words for one in robot.master.inventory.lines_of(YOURS) if one.words not in self._said],
                "answer": self._answer,
            }
        )

    def _numbered(self) -> list[tuple[int, DemoStateChange]]:
        return list(enumerate(self._events, self._event_count - len(self._events) + 1))

    def _part(self, shown: dict[str, Any]) -> dict[str, object]:
        name = shown["name"]
        return {
            **{key: shown[key] for key in ("name", "part_number", "slot", "state", "plugged", "beats")},
            **{key: shown[key] for key in ("messages_in", "messages_out")},
            "is_yours": name == YOURS,
            "reason": self._reasons.get(name, ""),
            **_device(self.robot.simulated(name)),
        }

    def _decode(self) -> None:
        """Put the new frames into words; a frame is understood only by who has heard those before it."""
        new = list(self._frames)
        self._frames.clear()
        for number, at, sender, frame in new:
            words = self._words.explain_frame(frame, at)
            plain = " / ".join(islice(words.plain or words.about, 2))
            self._shown.append({"number": number, "sender": sender, "frame": show_frame(frame), "words": plain})


def _words(error: Exception) -> str:
    return sentence(error) if isinstance(error, MsbotError) else f"{type(error).__name__}: {sentence(error)}"


def _device(unit: SimulatedPart | None) -> dict[str, object]:
    """What one sees at a simulated device, and what one can do to it; nothing without one."""
    if unit is None or unit.part_type.simulator is None:
        return {"readings": [], "controls": []}
    values = unit.readings()
    readings = [
        {"words": one.words or one.name, "unit": one.unit, "value": values[one.name]}
        for one in unit.part_type.simulator.readings
        if one.shown
    ]
    controls = [
        {
            **{key: getattr(one, key) for key in ("name", "words", "unit", "least", "most")},
            "kind": one.kind.value,
            "value": unit.value(one.name),
        }
        for one in unit.controls
    ]
    return {"readings": readings, "controls": controls}


class _ProgramErrors(logging.Handler):
    """Mistakes in functions of the visitor's program, which a part writes for the person at its terminal."""

    def __init__(self, say: Callable[[str], object]) -> None:
        super().__init__(logging.ERROR)
        self._say = say

    def emit(self, record: logging.LogRecord) -> None:
        """Pass it on."""
        self._say(record.getMessage())
