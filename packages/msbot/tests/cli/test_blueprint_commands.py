"""`msbot check`, `diff`, `apply`, `export`, `robots`: a blueprint and the database against each other."""

import json
from collections.abc import Callable, Mapping
from pathlib import Path

import click
import pytest
from click.testing import CliRunner, Result

from msbot.cli.change import robot_access as control
from msbot.config import write_sample
from msbot.registry import open_registry
from msbot_agent.cli import msbot
from msbot_xrce.errors import ConfigError, MsbotError
from tests.registry.hand import Hand

Run = Callable[..., Result]


@pytest.fixture
def run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Run:
    """Call a command in a folder with the sample's robot.toml and no database."""
    monkeypatch.chdir(tmp_path)
    write_sample(Path("robot.toml"))

    def run(name: str, *arguments: str, answer: str = "") -> Result:
        command = msbot.get_command(click.Context(msbot), name)
        assert command is not None
        result = CliRunner().invoke(command, arguments, input=answer)
        if isinstance(result.exception, MsbotError):
            raise result.exception
        return result

    return run


def _edit(old: str, new: str) -> None:
    path = Path("robot.toml")
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new))


# slot


def test_a_new_slot_is_written_to_the_end_and_in_force(run: Run) -> None:
    run("apply", "--yes")
    before = Path("robot.toml").read_text()
    assert run("slot", "add", "eye", "TCS34725", "--description", 'The "eye"').output == (
        "slot eye is now in robot.toml; robot MSBOT_MASTER is as robot.toml says; `msbot undo` takes it back\n"
    )
    after = Path("robot.toml").read_text()
    assert after.startswith(before)
    assert after.endswith('\n[[slot]]\nname = "eye"\npart = "TCS34725"\ndescription = "The \\"eye\\""\n')
    assert run("diff").exit_code == 0
    assert json.loads(run("slot", "add", "ear", "KY-037", "--json").output)["slot"] == "ear"


def test_a_slot_that_will_not_do_leaves_the_file_as_it_was(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    before = Path("robot.toml").read_bytes()
    for arguments, words in (
        (("AA", "ABCD"), 'there is a slot "AA" already'),
        (("eye", "TCS34726"), 'no part number "TCS34726"; did you mean "TCS34725"'),
        (("a.b", "ABCD"), "must not contain"),
    ):
        with pytest.raises(ConfigError, match=words):
            run("slot", "add", *arguments)
        assert Path("robot.toml").read_bytes() == before
    Path("robot.db").write_bytes(b"no database at all, but a text that is long enough to be taken for one" * 20)
    with pytest.raises(MsbotError):
        run("slot", "add", "eye", "TCS34725")
    assert Path("robot.toml").read_bytes() == before


@pytest.mark.promise("Other users of the computer change nothing that a program of MsBOT runs")
def test_what_others_put_beside_the_file_is_not_written_through(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    """In a folder that others may write to: a link in the place of the draft leads to a file of this user."""
    before = Path("robot.toml").read_bytes()
    Path("precious").write_text("mine")
    monkeypatch.setattr("secrets.token_hex", lambda _: "guessed")
    link = Path(".robot.toml.guessed")
    link.symlink_to("precious")
    with pytest.raises(ConfigError, match="cannot be written"):
        run("slot", "add", "eye", "TCS34725")
    assert Path("precious").read_text() == "mine"
    assert Path("robot.toml").read_bytes() == before


# check


def test_a_blueprint_in_order(run: Run) -> None:
    result = run("check")
    assert result.output == "robot.toml is in order: robot MSBOT_MASTER, 3 slots, 3 bindings.\n"
    assert json.loads(run("check", "--json").output) == {"problems": [], "hints": []}


def test_problems_are_told_with_file_line_and_key(run: Run) -> None:
    _edit('part = "EFGH"', 'part = "EFGX"')
    with pytest.raises(
        ConfigError, match=r'robot.toml, line \d+, slot\[1\].part: the library has no part number "EFGX"'
    ):
        run("check")
    result = run("check", "--json")
    (problem,) = json.loads(result.output)["problems"]
    assert (result.exit_code, problem["file"], problem["key"]) == (2, "robot.toml", "slot[1].part")
    assert Path("robot.toml").read_text().splitlines()[problem["line"] - 1].startswith('part = "EFGX"')
    assert problem["words"].startswith('the library has no part number "EFGX"; did you mean')


def test_what_is_perhaps_not_meant_is_a_hint(run: Run) -> None:
    _edit('from = "CC.out"\nto = ["AA.in"]', 'from = "CC.out"\nto = ["BB.in"]')
    _edit('topic = "HelloWorldTopic_3_to_1"', 'topic = "HelloWorldTopic_1_to_2"')
    with Path("robot.toml").open("a") as stream:
        stream.write('[[slot]]\nname = "DD"\npart = "ABCD"\n')
    assert run("check").output.splitlines()[:-1] == [
        "hint: slot AA: not bound to a topic: in",
        "hint: no port of slot DD is bound to a topic: its part will do nothing",
        "hint: slots AA, DD take the same part ABCD: the parts need these as local names",
    ]


# diff, apply


def test_a_new_robot_is_shown_asked_for_and_made(run: Run) -> None:
    assert not Path("robot.db").exists()
    result = run("diff")
    assert (result.exit_code, result.output.splitlines()[0]) == (
        1,
        "there is no database robot.db yet; `msbot apply robot.toml` would make it, with this robot:",
    )
    with pytest.raises(ConfigError, match="nobody is there to ask: add --yes"):
        run("apply")
    lines = run("apply", "--yes").output.splitlines()
    assert lines[0] == "robot.db gets a new robot:"
    assert lines[1] == "  + slot AA: part ABCD"
    assert lines[-2:] == ["  6 added.", "robot MSBOT_MASTER is in the database now"]
    assert run("diff").output == "robot.db has what robot.toml says.\n"
    assert run("diff").exit_code == 0
    assert run("apply").output == "robot.db has what robot.toml says: nothing to change.\n"


def test_a_change_is_shown_made_and_taken_back(run: Run) -> None:
    run("apply", "--yes")
    _edit('description = "Toggle switch, 5V"', 'description = "A switch"')
    shown = '  ~ slot BB, description: "Toggle switch, 5V" -> "A switch"'
    assert run("diff").output.splitlines() == [
        "`msbot apply robot.toml` would change in robot.db:",
        shown,
        "  1 changed.",
    ]
    assert run("apply", "--yes").output.splitlines() == [
        "robot.toml changes in robot.db:",
        shown,
        "  1 changed.",
        "robot MSBOT_MASTER is as robot.toml says; `msbot undo` takes it back",
    ]
    with open_registry("robot.db") as registry:
        (robot,) = registry.robots.all()
        (edit,) = registry.edits.latest(robot)
        assert (edit.kind, edit.who != "msbot") == ("apply", True)
        Hand(registry).undo(robot, None, "Ann")
    assert run("diff").exit_code == 1


def test_for_programs(run: Run) -> None:
    made = json.loads(run("apply", "--yes", "--json").output)
    assert (len(made["changed"]), made["words"]) == (6, "robot MSBOT_MASTER is in the database now")
    assert json.loads(run("apply", "--yes", "--json").output) == {"changed": [], "words": "nothing to change"}
    _edit("explain = true", "explain = false")
    told = json.loads(run("diff", "--json").output)
    assert (told["new"], told["by_hand"]) == (False, [])
    assert told["apply"] == [
        {
            "change": "changed",
            "where": "options, explain",
            "before": "true",
            "after": "false",
            "consequence": "holds from the master's next start on",
        }
    ]
    assert "--json does not ask: add --yes" in run("apply", "--json").output


def test_a_running_robot_is_changed_through_its_master(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    run("apply", "--yes")
    _edit("explain = true", "explain = false")
    asked: list[object] = []

    def perform(db: str | None, robot: str | None, do: str, args: Mapping[str, object]) -> dict[str, object]:
        asked.append((db, robot, do, args))
        return {"words": "done"}

    monkeypatch.setattr(control, "perform", perform)
    with open_registry("robot.db") as registry:
        registry.runs.begin(registry.robots.all()[0])
        assert run("apply", "--yes").output.splitlines()[-1] == "done"
        assert registry.edits.latest(registry.robots.all()[0]) == []
    path = str(Path("robot.toml").resolve())
    assert asked == [("robot.db", "MSBOT_MASTER", "apply", {"path": path, "folders": []})]


# export


def test_what_is_exported_can_be_applied(run: Run) -> None:
    run("apply", "--yes")
    assert run("export", "copy.toml").output == "copy.toml is written: robot MSBOT_MASTER.\n"
    assert run("diff", "copy.toml", "--db", "robot.db").exit_code == 0
    assert run("export").output == Path("copy.toml").read_text()
    with pytest.raises(ConfigError, match=r"copy\.toml: exists already and is not overwritten"):
        run("export", "copy.toml")
    with pytest.raises(ConfigError, match=r"no/copy\.toml: cannot be written \(No such file or directory\)"):
        run("export", "no/copy.toml")


def test_what_was_made_by_hand_is_shown_and_exported(run: Run) -> None:
    run("apply", "--yes")
    with open_registry("robot.db") as registry:
        Hand(registry).unbind(registry.robots.all()[0], "HelloWorldTopic_3_to_1", None, "Ann")
    assert run("diff").output.splitlines() == [
        "robot.db has what robot.toml says.",
        "Changed by hand, which stays (`msbot export` writes it down):",
        "  - topic HelloWorldTopic_3_to_1: CC.out -> AA.in [HelloWorld]",
        "  1 removed.",
    ]
    assert "HelloWorldTopic_3_to_1" not in run("export").output
    assert "HelloWorldTopic_3_to_1" in run("export", "--without-hand").output


# robots


def test_the_robots_of_a_database(run: Run) -> None:
    open_registry("robot.db").close()
    assert "There is no robot in it yet" in run("robots").output
    with pytest.raises(
        ConfigError,
        match=r"there is no robot in the database robot\.db yet: `msbot apply robot.toml` or `msbot",
    ):
        run("export")
    run("apply", "--yes")
    _edit('serial_number = "X100Y100Z100"', 'serial_number = "2"')
    run("apply", "--yes")
    rows = json.loads(run("robots", "--json").output)
    assert [(row["serial_number"], row["slots"], row["filled"], row["running"]) for row in rows] == [
        ("2", 3, 0, False),
        ("X100Y100Z100", 3, 0, False),
    ]
    assert "MSBOT_MASTER" in run("robots").output
    with pytest.raises(ConfigError, match="has several robots: say which with --robot; MSBOT_MASTER"):
        run("export")
    assert 'serial_number = "2"' in run("export", "--robot", "2").output
    with pytest.raises(ConfigError, match="has no robot 'R2'; did you mean"):
        run("export", "--robot", "R2")
