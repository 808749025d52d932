"""The reference page says what the code says."""

from dataclasses import fields

from msbot.part.client.client_settings import ClientSettings
from msbot.part.join.joining import TRANSITIONS, JoinEvent, JoinState
from msbot.part.part import Part
from msbot.part.program_runner import PartCounters
from tests import ROOT

PAGE = (ROOT / "docs/reference/part.md").read_text()


def test_the_table_of_states_is_the_table_of_transitions() -> None:
    table = PAGE.partition("| event | in | leads to |\n")[2].partition("\n\n")[0].splitlines()[1:]
    shown = set()
    for line in table:
        event, before, after = (cell.strip() for cell in line.strip("|").split("|"))
        shown |= {(JoinState(state), JoinEvent(event), JoinState(after)) for state in before.split(", ")}
    assert shown == {
        (before, event, after) for (before, event), after in TRANSITIONS.items() if event is not JoinEvent.END
    }


def test_every_setting_counter_and_public_name_of_a_part_is_listed() -> None:
    names = [field.name for field in (*fields(ClientSettings), *fields(PartCounters))]
    names += [name for name in (*vars(Part), *vars(Part("X"))) if not name.startswith("_")]
    missing = [name for name in names if f"`{name}" not in PAGE and f"part.{name}" not in PAGE]
    assert missing == []
