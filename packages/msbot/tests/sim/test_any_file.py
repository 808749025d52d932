"""Whatever stands in a library file: it is refused with sentences, or its simulator works without an error."""

from __future__ import annotations

import re
from importlib.resources import files
from random import Random

from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from msbot.config import Control, ControlKind, Direction, PartType, Scalar, standard_message_types
from msbot.config.library.part_file_reader import open_library_file, read_part_type
from msbot.sim.model_part import message_of
from msbot.sim.part_model import PartModel
from msbot_agent.toml.document import parse_document
from msbot_agent.toml.problems import Problems
from tests.effort import tries

TEXTS = [
    entry.read_text()
    for entry in sorted((files("msbot.config.library") / "types").iterdir(), key=lambda e: e.name)
    if entry.name.endswith(".toml")  # what has been read of them is kept in a folder beside them
]
KEYS = [
    "follows", "scale", "offset", "divide_by", "start", "text", "random_every", "equals", "above", "negate", "function",
    "min", "max", "integrate", "lag_s", "slew_per_s", "noise", "step", "wrap", "pattern", "rows", "columns", "lasts",
    "hidden", "every", "on_change", "change", "only_if", "momentary", "name", "port",
]  # fmt: skip
VALUES = [
    "true", "false", "-1", "0", "0.5", "1e300", "1e-300", "nan", "inf", '""', '"x"', "'(.)'", '"{knob:d}"', '"#out"',
    '"#in"', '"in.message"', '"sin"', "{}", "[]",
]  # fmt: skip
"""What is put into a file: keys of the simulator, values of all kinds."""


@st.composite
def changed_files(draw: st.DrawFn) -> str:
    """A file of the library in which some words were exchanged, and some lines put into the simulator."""
    text = draw(st.sampled_from(TEXTS))
    names = re.findall(r'(?m)^name = ("\w+")$', text)
    values = st.sampled_from(VALUES + names)
    lines = text.splitlines()
    for _ in range(draw(st.integers(0, 2))):
        at = draw(st.integers(0, len(lines) - 1))
        lines[at] = lines[at].partition("=")[0] + "= " + draw(values)
    tables = [at for at, line in enumerate(lines) if line.startswith("[[simulator.")]
    for at in draw(st.lists(st.sampled_from(tables or [len(lines) - 1]), max_size=3)):
        lines[at] += f"\n{draw(st.sampled_from(KEYS))} = {draw(values)}"
    return "\n".join(lines)


def values_of(control: Control) -> list[Scalar]:
    match control.kind:
        case ControlKind.BOOL:
            return [True, False]
        case ControlKind.CHOICE:
            return list(control.choices)
        case ControlKind.TEXT:
            return ["", "a\0b", "3"]
    return [value for value in (0.0, -1e300, 1e300, 5.0) if control.fault(value) is None]


def play_with(part_type: PartType) -> None:
    """Do everything one can do to a simulated part, as fast and as slowly as can be."""
    assert part_type.simulator is not None
    world = PartModel(part_type, Random(1))
    now = 100.0
    world.start_at(now)
    world.join(now)
    heard = []
    for pause_s in (0.0, 0.05, 3.0, 1e6):
        for control in part_type.simulator.controls:
            for value in values_of(control):
                now += pause_s
                world.set(control.name, value, now)
                world.note_changes()
        for port in part_type.ports:
            if port.direction is Direction.SUBSCRIBE and port.message is not None:
                zero = {name: kind.zero for name, kind in port.message.leaves.items()}
                for fields in (zero, dict(port.safe or {})):
                    world.receive(port.name, fields, now)
        world.advance(now)
        heard += world.due_messages(now)
    for port_name, fields in heard:
        found = part_type.port(port_name)
        assert found is not None
        assert found.message is not None
        message_of(found.message, fields).encode()


@settings(deadline=None, max_examples=tries(150, 3000), suppress_health_check=[HealthCheck.too_slow])
@given(changed_files())
def test_a_file_is_refused_with_a_sentence_or_its_simulator_works(text: str) -> None:
    problems = Problems()
    document = parse_document(text, "x.toml", problems)
    if document is None:
        assert problems.found
        return
    part_type = read_part_type(open_library_file(document, problems), standard_message_types())
    if not problems.found:
        assert part_type is not None
        play_with(part_type)
    for problem in problems.found:
        assert problem.place.file == "x.toml"
        assert problem.sentence
