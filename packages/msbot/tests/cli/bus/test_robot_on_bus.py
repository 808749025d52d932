"""A dump that begins when all parts have long joined: the master that serves the bus says what they set up."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path

import pytest

from msbot.cli.bus import bus_source as module
from msbot.cli.bus.bus_source import robot_on_bus
from msbot.pnp import KnownObject
from msbot_agent.agent import RunningProcess
from tests.cli.live_bus import bus, invoke, runtime_folder, talking
from tests.e2e.processes import run, running

__all__ = ["bus", "runtime_folder", "talking"]


def test_sentences_begin_at_once_also_without_a_blueprint(tmp_path: Path) -> None:
    env = {"XDG_RUNTIME_DIR": str(tmp_path), "XDG_STATE_HOME": str(tmp_path)}
    with running("demo", "--robot", "rover", "--bus", "late1", "--no-page", cwd=tmp_path, env=env) as demo:
        demo.wait_for("knob active", "ear active", "fan active")
        dumped = run("bus", "dump", "sim:late1", "--count", "300", cwd=tmp_path, env=env)
    shown, said = dumped.stdout, dumped.stderr
    assert re.search(r"  knob says level \d+(\.\d+)? %", shown)
    assert re.search(r"  fan hears power \d+(\.\d+)? %", shown)
    assert "WRITE_DATA" not in shown
    assert said == ""


def test_without_a_master_the_dump_says_what_it_cannot_say(talking: object) -> None:
    result = invoke("dump", "sim:bench1", "--count", "1")
    assert "no master on this computer serves sim:bench1: what joined before has no sentences" in result.stderr
    assert "node 3 to master" in result.stdout
    assert "no master" not in invoke("dump", "sim:bench1", "--count", "1", "--no-decode").stderr


class _Answers(RunningProcess):
    """A master that answers what the test wants."""

    def __init__(self, answer: Mapping[str, object], what: str = "master") -> None:
        object.__setattr__(self, "what", what)
        object.__setattr__(self, "name", "R2")
        object.__setattr__(self, "answer", answer)

    def ask(self, request: object, *, patience_s: float = 0.0, waits_s: float = 0.0) -> dict[str, object]:
        return dict(self.answer)  # type: ignore[attr-defined]


def test_what_several_masters_know_is_put_together_and_nonsense_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    own: dict[str, object] = {"buses": {"can:can0": [[3, 0x15, "t", "Level", "knob", "level"]]}, "types": []}
    other = {"buses": {"can:can1": [[3, 0x15, "u", "Level", "fan", "power"]]}, "types": []}
    wrong = {"buses": {"can:can0": [["x"]]}, "types": []}
    old: dict[str, object] = {"error": "there is no operation 'objects'"}
    answers = [_Answers(other), _Answers(own), _Answers(wrong), _Answers(old), _Answers({}, what="agent")]
    monkeypatch.setattr(module, "running_processes", lambda: answers)
    said: list[str] = []
    found = robot_on_bus("can0", said.append)
    assert found is not None
    assert found.learn_object(3, 0x15) == KnownObject("t", "Level", "knob", "level")
    assert found.learn_object(4, 0x15) is None
    assert len(said) == 1
    assert "master R2: its answer about can:can0 makes no sense" in said[0]
