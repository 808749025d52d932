"""Reads mission files: every mistake with its line and what would be right."""

from __future__ import annotations

from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Final

from msbot.operations.fault_request import FaultRequest
from msbot.operations.table import OPERATIONS
from msbot_agent.startup.extensions import extensions
from msbot_agent.text.sentence import said
from msbot_agent.text.similar_names import instead_of
from msbot_agent.text.untrusted_input import open_input_text
from msbot_agent.toml.document import MOST_BYTES, Document, parse_document
from msbot_agent.toml.problems import Problems
from msbot_agent.toml.table import Table
from msbot_school.faults.fault_kinds import KINDS, FaultKind, read_condition
from msbot_school.missions.mission import (
    LONGEST_S,
    QUICK_SHARE,
    TIME_S,
    DrawnFault,
    Marks,
    Mission,
    MissionFault,
    Task,
    contradiction_of,
)
from msbot_xrce.errors import ConfigError

MOST_FAULTS: Final = 8
MOST_HINTS: Final = 10
MOST_TASKS: Final = 20
MOST_MARKS: Final = 100.0
MOST_SLOTS: Final = 100
MOST_TEXT: Final = 30_000
"""Characters of a mission file that comes by page or command."""


def parse_mission(text: str, file: str) -> Mission:
    """The mission in a TOML text; `file` is its name in messages, and without its ending that of the mission.

    Raises:
        ConfigError: something in it is wrong; the text names every mistake with line and remedy.
    """
    problems = Problems()
    document = parse_document(text, file, problems)
    problems.raise_if_any()
    assert document is not None
    mission = _mission(document, problems, text)
    problems.raise_if_any()
    return mission


def load_mission(path: Path) -> Mission:
    """The mission of a file.

    Raises:
        ConfigError: it cannot be read, or something in it is wrong.
    """
    try:
        with open_input_text(path) as stream:
            text = stream.read(MOST_BYTES + 1)  # it may be a device without an end; too much is told when it is parsed
    except UnicodeDecodeError:
        raise ConfigError(said("{path}: is no text in UTF-8; save it as UTF-8", path=str(path))) from None
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) else str(error)
        raise ConfigError(
            said("{path}: cannot be read ({reason}); name another file", path=str(path), reason=reason)
        ) from None
    return parse_mission(text, str(path))


@cache
def ready_missions() -> dict[str, Mission]:
    """The missions that MsBOT and its extensions bring, by name; of an extension with a mistake in a file, none."""
    found = {}
    for entry in sorted((files("msbot_school.missions") / "ready").iterdir(), key=lambda one: one.name):
        if entry.name.endswith(".toml"):
            mission = parse_mission(entry.read_text("utf-8"), entry.name)
            found[mission.name] = mission
    for name, folder in extensions().folders("missions").items():
        try:
            brought = {one.name: one for one in map(load_mission, sorted(folder.glob("*.toml")))}
        except ConfigError as error:
            extensions().leave_out_named("missions", name, str(error))
            continue
        taken = sorted(set(brought).intersection(found))
        if taken:
            extensions().leave_out_named("missions", name, f"there is a mission {taken[0]!r} already")
            continue
        found.update(brought)
    return found


def ready_mission(name: str) -> Mission:
    """The ready mission of that name.

    Raises:
        ConfigError: there is none; the text lists them.
    """
    mission = ready_missions().get(name)
    if mission is None:
        raise ConfigError(
            said(
                "there is no mission {name!r}; one of your own is a file, such as {name}.toml; {hint}",
                name=name,
                hint=instead_of(name, ready_missions()),
            )
        )
    return mission


def _mission(document: Document, problems: Problems, text: str) -> Mission:
    top = Table(document, problems, document.values)
    about = top.table("mission", required=True)
    robot = top.table("robot")
    time_s = about.number("time_s", default=TIME_S, least=0.0, most=LONGEST_S, unit="s", above=True)
    faults = [_fault(table, time_s) for table in top.tables("fault")]
    tasks = [_task(table, time_s) for table in top.tables("do")]
    if not faults:
        top.report(said("in a mission something goes wrong: add a [[fault]] with kind and at"))
    for key, found, most in (("fault", faults, MOST_FAULTS), ("do", tasks, MOST_TASKS)):
        if len(found) > most:
            top.report(said("{count} are too many; {most} are possible", count=len(found), most=most), key)
    hints = about.proses("hints", 'Open \\"Why?\\"')
    if len(hints) > MOST_HINTS:
        about.report(said("{count} are too many; {most} are possible", count=len(hints), most=MOST_HINTS), "hints")
    avoid = about.names("avoid", "stop")
    for position, name in enumerate(avoid):
        _check_operation(about, name, "avoid", position)
    slots = robot.names("slots", "fan")
    if len(slots) > MOST_SLOTS:
        robot.report(said("{count} are too many; {most} are possible", count=len(slots), most=MOST_SLOTS), "slots")
    mission = Mission(
        name=Path(document.file).stem,
        title=about.prose("title", "The fan has moods", most=100),
        story=about.prose("story", "What is wrong, and where?"),
        faults=tuple(faults),
        time_s=time_s,
        hints=tuple(hints),
        explanation=about.prose("explanation", "", default=""),
        avoid=tuple(avoid),
        sample=robot.text("sample", "rover"),
        slots=tuple(slots),
        tasks=tuple(tasks),
        marks=_marks(top.table("marks"), time_s),
        source=text,
    )
    for table in (about, robot, top):
        table.finish()
    _check_contradictions(top, mission)
    return mission


def _marks(table: Table, time_s: float) -> Marks:
    usual = Marks()
    found = {
        name: table.number(name, default=getattr(usual, name), least=0.0, most=MOST_MARKS)
        for name in ("place", "kind", "quick", "mend", "do", "wrong", "hint")
    }
    quick_s = table.number("quick_s", default=time_s * QUICK_SHARE, least=0.0, most=time_s, unit="s")
    table.finish()
    return Marks(**found, quick_s=quick_s)


def _fault(table: Table, time_s: float) -> MissionFault:
    kinds = tuple(_one_or_several(table, "kind", "loss"))
    at = tuple(_one_or_several(table, "at", "fan", required=False))
    known = [KINDS[kind] for kind in kinds if kind in KINDS]
    for position, kind in enumerate(kinds):
        if kind not in KINDS:
            table.report(
                said("there is no fault {name!r}; {hint}", name=kind, hint=instead_of(kind, KINDS)),
                "kind",
                *([position] if len(kinds) > 1 else []),
            )
    if not kinds and "kind" in table:
        table.report(said('is empty; write for example kind = "loss"'), "kind")
    if any(kind.at_part for kind in known) and not at:
        table.report(
            said(
                '{kind} is planted at a part: add at = "SLOT"', kind=next(kind.name for kind in known if kind.at_part)
            ),
            "kind",
        )
    if at and known and not any(kind.at_part for kind in known):
        table.report(said("{kind} concerns the whole robot: remove it", kind=known[0].name), "at")
    amount = _amount(table, known)
    given = {"jitter": "jitter_ms", "port": "port", "number": "number"}
    for option, key in given.items():
        if key in table and not any(option in kind.options for kind in known):
            table.report(said("{kind} knows no {key}: remove it", kind=", ".join(kinds), key=key), key)
    fault = MissionFault(
        kinds,
        at,
        amount,
        jitter_ms=table.number("jitter_ms", default=0.0, least=0.0, most=10_000.0, unit="ms") or None,
        port=table.text("port", "level"),
        number=table.text("number", "LED"),
        after_s=table.number("after_s", default=0.0, least=0.0, most=time_s, unit="s"),
        for_s=table.number("for_s", default=0.0, least=0.1, most=LONGEST_S, unit="s") or None,
        when=_condition(table, "when"),
        chance=table.number("chance", default=0.0, least=0.0, most=1.0, above=True) or None,
        seed=table.whole("seed", default=0, least=0, most=2**53) if "seed" in table else None,
        find=table.flag("find", default=True),
        mend=table.flag("mend", default=True),
    )
    table.finish()
    return fault


def _amount(table: Table, kinds: list[FaultKind]) -> float | None:
    if "amount" not in table:
        return None
    amounts = [(kind.name, kind.amount) for kind in kinds]
    if without := [name for name, amount in amounts if amount is None]:
        table.report(said("{kind} has no amount: remove it", kind=", ".join(without)), "amount")
    limits = [amount for _, amount in amounts if amount is not None]
    least = max((one.least for one in limits), default=-1e6)
    most = min((one.most for one in limits), default=1e6)
    default = limits[0].default if limits else 1.0
    return table.number("amount", default=default, least=least, most=most, unit=limits[0].unit if limits else "")


def _task(table: Table, time_s: float) -> Task:
    operation = table.name("operation", "identify", default="")
    until = _condition(table, "until")
    if bool(operation) == bool(until):
        table.report(
            said('either operation or until must be there, as in operation = "identify" or until = "fan is active"')
        )
    arguments = {name: str(value) for name, value in table.scalars("with").items()}
    if operation and _check_operation(table, operation, "operation"):
        for name in arguments:
            if OPERATIONS[operation].argument(name) is None:
                known = ", ".join(one.name for one in OPERATIONS[operation].arguments) or said("nothing")
                table.report(
                    said(
                        "{operation} knows no {unknown}; it takes {names}",
                        operation=operation,
                        unknown=name,
                        names=known,
                    ),
                    "with",
                    name,
                )
    task = Task(
        words=table.prose("words", "Make the fan show itself."),
        operation=operation,
        arguments=arguments,
        until=until,
        within_s=table.number("within_s", default=0.0, least=0.0, most=time_s, unit="s", above=True) or None,
    )
    table.finish()
    return task


def _check_operation(table: Table, name: str, *steps: str | int) -> bool:
    row = OPERATIONS.get(name)
    if row is None:
        table.report(
            said(
                "there is no operation {operation!r}; there are {operations}",
                operation=name,
                operations=", ".join(one.name for one in OPERATIONS.values() if not one.is_question),
            ),
            *steps,
        )
    elif row.is_question:
        table.report(said("{operation} only asks: nobody notes who did", operation=name), *steps)
        return False
    return row is not None


def _condition(table: Table, key: str) -> str:
    text = table.text(key, "fan is active")
    if text:
        try:
            read_condition(text)
        except ConfigError as error:
            table.report(str(error), key)
    return text


def _one_or_several(table: Table, key: str, example: str, *, required: bool = True) -> list[str]:
    if isinstance(table.item(key), list):
        return table.names(key, example)
    one = table.name(key, example, default=None if required else "")
    return [one] if one else []


def _check_contradictions(top: Table, mission: Mission) -> None:
    """Two faults without choice, there at the same time, that contradict each other."""
    certain = [
        (DrawnFault(number, FaultRequest(one.kinds[0], one.at[0] if one.at else ""), find=True, mend=True), one)
        for number, one in enumerate(mission.faults, 1)
        if len(one.kinds) == 1 and one.kinds[0] in KINDS and len(one.at) <= 1 and not one.when and one.chance is None
    ]
    for place, (other, second) in enumerate(certain):
        for one, first in certain[:place]:
            first_end = first.after_s + (first.for_s or LONGEST_S)
            second_end = second.after_s + (second.for_s or LONGEST_S)
            reason = contradiction_of(one, other)
            if reason and first.after_s < second_end and second.after_s < first_end:
                top.report(
                    said(
                        "contradicts fault[{index}]: {reason}; let one end (for_s) before the other begins (after_s)",
                        index=one.number - 1,
                        reason=reason,
                    ),
                    "fault",
                    other.number - 1,
                )
