"""The table of operations and what is made from it agree."""

from __future__ import annotations

import inspect
import re
import subprocess
import sys
from pathlib import Path

import pytest

from msbot.cli.change.change_commands import verb
from msbot.operations.blocking import Blocking, StoredBlocking
from msbot.operations.dispatch import InProcessOperations
from msbot.operations.operation import EditLog, OperationScope
from msbot.operations.placement import Placement
from msbot.operations.slot_configuration import SlotSettings, Wires
from msbot.operations.stored_robot import StoredPlacement
from msbot.operations.table import OPERATIONS
from msbot.operations.undo_operations import StoredUndoing
from msbot.registry import EditKind
from msbot.registry.records import UNDOABLE
from msbot_agent.cli import COMMANDS
from tests import ROOT
from tests.operations.stage import Stage, play


def test_every_operation_has_its_method_with_the_arguments_of_the_table(tmp_path: Path) -> None:
    async def scene(stage: Stage) -> None:
        operations = stage.operations
        assert isinstance(operations, InProcessOperations)
        assert operations._methods.keys() == OPERATIONS.keys()
        for name, row in OPERATIONS.items():
            wanted = {argument.passed_as for argument in row.arguments} | (set() if row.is_question else {"who"})
            wanted |= {"place"} if row.takes_place else set()
            assert set(inspect.signature(operations._methods[name]).parameters) == wanted, name

    play(tmp_path, scene)


def test_where_an_operation_can_act_is_what_the_table_says() -> None:
    groups = (SlotSettings, StoredUndoing, StoredPlacement, StoredBlocking, Wires)
    stored = {name for name in OPERATIONS if any(hasattr(group, name) for group in groups)}
    assert stored == {name for name, row in OPERATIONS.items() if row.where is OperationScope.ANYWHERE}
    assert {"swap", "block"} <= {name for name in OPERATIONS if hasattr(Placement, name) or hasattr(Blocking, name)}


def test_the_journals_words_are_those_of_the_registry() -> None:
    words = {kind.value for kind in EditKind}
    for name, row in OPERATIONS.items():
        assert (row.journal in words) == (row.kept is not EditLog.NOTHING), name
        assert (row.journal in UNDOABLE) == (row.kept is EditLog.UNDOABLE), name


def test_the_path_of_a_call_names_arguments_of_its_operation() -> None:
    for name, row in OPERATIONS.items():
        in_path = set(re.findall(r"{(\w+)}", row.call))
        assert in_path <= {argument.name for argument in row.arguments if argument.is_needed}, name
    calls = [row.call for row in OPERATIONS.values() if row.call]
    assert len(calls) == len(set(calls))


def test_the_help_of_msbot_has_the_summary_of_each_operation() -> None:
    one_word = {*MADE, "adopt", "set", "undo", "stop", "go", "publish", "simulate", "call"}
    assert {name: COMMANDS[name] for name in one_word} == {name: OPERATIONS[name].summary for name in one_word}


MADE = ("swap", "release", "block", "unblock", "bind", "unbind", "identify")


@pytest.mark.parametrize("name", MADE)
def test_a_command_takes_what_its_operation_takes(name: str) -> None:
    command = verb(name)
    taken = {parameter.name for parameter in command.params} - {"db", "robot", "as_json"}
    assert taken == {argument.passed_as for argument in OPERATIONS[name].arguments}


def test_a_swap_passes_six_layers_at_most_from_the_api_to_sql_and_a_setting_five_at_each_end() -> None:
    done = subprocess.run(
        [sys.executable, ROOT / "tools" / "layers_of_an_operation.py"], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
