"""`msbot part`: which part is run, with what."""

from __future__ import annotations

from pathlib import Path

import pytest
from click.testing import CliRunner

import msbot.cli.run.part
from msbot.config import write_sample
from msbot.part import Part, PinDirection
from msbot_xrce.errors import ConfigError

Ran = list[tuple[Part, dict[str, object]]]


@pytest.fixture
def ran(monkeypatch: pytest.MonkeyPatch) -> Ran:
    """The parts that would be run, with their arguments."""
    found: Ran = []
    monkeypatch.setattr(msbot.cli.run.part, "run_parts", lambda parts, **options: found.append((parts[0], options)))
    return found


def invoke(*arguments: str) -> str:
    result = CliRunner().invoke(msbot.cli.run.part.command, list(arguments), catch_exceptions=False)
    assert result.exit_code == 0, result.output
    return result.output


def test_any_type_of_the_library_runs(ran: Ran) -> None:
    text = invoke("POT-10K", "--set", "knob=80", "--name", "volume", "--link", "udp:127.0.0.1:1", "--uid", "00" * 8)
    part, options = ran[0]
    assert (part.part_number, part.local_name) == ("POT-10K", "volume")
    assert options == {"link": "udp:127.0.0.1:1", "uid": "00" * 8, "key": None, "quiet": False}
    assert text == "Potentiometer, 10 kilo-ohm; controls: knob (0 to 100 %)\n"


def test_the_parts_of_the_sample_robot_are_those_of_the_thesis(ran: Ran) -> None:
    assert invoke("BB", "--quiet") == ""
    part, options = ran[0]
    assert (part.part_number, part.local_name, part.robot.name) == ("EFGH", "EFGH-local", "MSBOT_MASTER")
    assert options["quiet"]
    with pytest.raises(ConfigError, match="run its part number instead: msbot part ABCD"):
        invoke("AA", "--set", "x=1")


def test_the_sample_toggle_switch_says_what_its_outputs_do(ran: Ran, capsys: pytest.CaptureFixture[str]) -> None:
    invoke("BB", "--key", "key.txt")
    part, options = ran[0]
    assert options["key"] == "key.txt"
    part.board.set_direction(3, PinDirection.OUTPUT)
    part.board.set(3)
    assert capsys.readouterr().out == "output 3 is on\n"


def test_quiet_says_nothing(ran: Ran) -> None:
    assert invoke("LED", "-q") == ""
    assert ran[0][1]["quiet"]


def test_a_type_of_ones_own_runs(ran: Ran, tmp_path: Path) -> None:
    (tmp_path / "own.toml").write_text('number = "OWN"\nname = "Own"\n')
    assert invoke("OWN", "--library", str(tmp_path)) == "Own; this part has no controls\n"
    assert ran[0][0].part_number == "OWN"


def test_mistakes_are_told_before_anything_runs(ran: Ran) -> None:
    with pytest.raises(ConfigError, match='the library has no part number "ZZ"'):
        invoke("ZZ")
    with pytest.raises(ConfigError, match="control knob is 101"):
        invoke("POT-10K", "--set", "knob=101")
    assert ran == []


def test_a_simulated_part_stands_in_for_the_one_of_a_slot(
    ran: Ran, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    write_sample(tmp_path / "robot.toml")
    invoke("BB", "--simulate")  # a name of the sample robot comes first
    assert ran.pop()[0].part_number == "EFGH"
    (tmp_path / "robot.toml").write_text(
        (tmp_path / "robot.toml").read_text().replace('"BB"', '"switch"').replace("BB.", "switch.")
    )
    text = invoke("switch", "--simulate")
    part, options = ran[0]
    uid = options["uid"]
    assert part.part_number == "EFGH"
    assert text.splitlines()[0] == f"For slot switch; while another part holds it: msbot swap switch --to {uid}"
    assert invoke("EFGH", "--simulate") != ""
    assert len({one[1]["uid"] for one in ran}) == 2, "a UID of its own"
