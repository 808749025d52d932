"""The reference page says what the code says."""

from dataclasses import fields

from msbot.part.client.settings import ClientSettings
from msbot.part.join.joining import TRANSITIONS, JoinEvent, JoinState
from msbot.part.part import Part
from msbot.part.program_runner import PartCounters
from tests import ROOT

PAGE = (ROOT / "docs/reference/part.md").read_text()


def test_the_diagram_is_the_table_of_transitions() -> None:
    edges: dict[tuple[JoinState, JoinState], list[JoinEvent]] = {}
    for (before, event), after in TRANSITIONS.items():
        if event is not JoinEvent.END:
            edges.setdefault((before, after), []).append(event)
    drawn = PAGE.partition("stateDiagram-v2\n")[2].partition("```")[0].splitlines()
    assert drawn[1:] == [
        f"    {name(before)} --> {name(after)}: {', '.join(event.value for event in events)}"
        for (before, after), events in edges.items()
    ]


def name(state: JoinState) -> str:
    return state.value.replace(" ", "_")


def test_every_setting_counter_and_public_name_of_a_part_is_listed() -> None:
    names = [field.name for field in (*fields(ClientSettings), *fields(PartCounters))]
    names += [name for name in (*vars(Part), *vars(Part("X"))) if not name.startswith("_")]
    missing = [name for name in names if f"`{name}" not in PAGE and f"part.{name}" not in PAGE]
    assert missing == []
