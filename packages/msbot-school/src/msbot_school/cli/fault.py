"""`msbot fault`: let something go wrong on purpose in the robot that runs here."""

from __future__ import annotations

import json
import sys
from collections.abc import Mapping
from itertools import islice
from random import SystemRandom
from typing import TYPE_CHECKING, Any

import click
from click.shell_completion import CompletionItem

from msbot.cli import completers
from msbot.cli.change.robot_access import perform, say
from msbot.cli.robot_options import robot_and_json_options, robot_options
from msbot_agent.cli.exit_status import ExitStatus
from msbot_agent.cli.options import FiniteRange, WholeRange, json_option
from msbot_agent.cli.table import print_table
from msbot_xrce.counting import amount
from msbot_xrce.errors import ConfigError

if TYPE_CHECKING:
    from msbot_school.faults.fault_kinds import FaultKind


def _kinds(_: click.Context, __: click.Parameter, incomplete: str) -> list[CompletionItem]:
    """The kinds of faults, for a shell."""

    def find() -> list[str]:
        from msbot_school.faults.fault_kinds import KINDS

        return list(KINDS)

    return completers.in_time(find, incomplete)


@click.group("fault")
def fault_command() -> None:
    """Plant faults in a running robot, list them, end them.

    A fault ends after a minute, or --for; STOP and a restart of the master end all. Cards and `msbot why` show it,
    unless it is --hidden.
    """


@fault_command.command("add")
@click.argument("kind", shell_complete=_kinds)
@click.argument("at", required=False, default="", metavar="[SLOT|PART]", shell_complete=completers.parts)
@click.option(
    "--amount", type=FiniteRange(), metavar="NUMBER", help="Its strength, in the unit that `msbot fault kinds` lists."
)
@click.option("--jitter", type=FiniteRange(), metavar="MS", help="delay: up to so many random milliseconds more.")
@click.option("--port", default="", metavar="PORT", help="stuck, drift: only this port of the part.")
@click.option("--number", default="", metavar="NUMBER", help="wrong-number: the part number of the wrong part.")
@click.option("--after", type=FiniteRange(0, 3600), default=0.0, metavar="SECONDS", help="Begin after so many seconds.")
@click.option("--for", "for_s", type=FiniteRange(0.1, 3600), metavar="SECONDS", help="How long it lasts; default: 60.")
@click.option(
    "--when",
    default="",
    metavar="CONDITION",
    help="Begin when this holds: 'fan is active', 'knob.level > 60', 'load > 40'.",
)
@click.option("--chance", type=FiniteRange(0, 1), metavar="P", help="Begin in each second with this probability.")
@click.option("--seed", type=WholeRange(min=0), metavar="N", help="Seed of the random choices.")
@click.option("--hidden", is_flag=True, help="Do not show it on cards and in `msbot why`.")
@robot_and_json_options
def add(db: str | None, robot: str | None, *, for_s: float | None, **wish: object) -> None:
    """Plant a fault at the part in a slot, or in the whole robot."""
    try:
        say(db, robot, "plant_fault", {**wish, "for": for_s})
    except ConfigError as error:
        raise _restart_hinted(error, str(wish["kind"])) from None


def _restart_hinted(error: ConfigError, kind: str) -> ConfigError:
    """What the master said; of a kind that is installed here but that it does not know, why it does not."""
    from msbot_school.faults.fault_kinds import KINDS

    if not str(error).startswith(f"there is no fault {kind!r}") or kind not in KINDS:
        return error
    return ConfigError(
        f"the running master does not know the fault {kind!r}, which an extension here adds: restart the master (if it "
        "uses another environment, install the extension there first)"
    )


@fault_command.command("list")
@click.option("--answers", is_flag=True, help="Also the faults of a mission; its report says who has looked.")
@json_option
@robot_options
def list_faults(db: str | None, robot: str | None, *, answers: bool, as_json: bool) -> None:
    """List planted faults, hidden ones too; those of a mission only with --answers."""
    found = perform(db, robot, "faults", {"answers": answers})
    if as_json:
        click.echo(json.dumps(found))
        return
    faults = found.get("faults")
    rows = [_row(fault) for fault in faults] if isinstance(faults, list) else []
    if rows:
        print_table(("fault", "planted by", "state", "what goes wrong"), rows)
    else:
        click.echo("No fault is planted: `msbot fault kinds` says what there is.")


@fault_command.command("clear")
@click.argument("fault", type=WholeRange(min=1), required=False, metavar="[ID]")
@robot_and_json_options
def clear(fault: int | None, db: str | None, robot: str | None) -> None:
    """End fault ID, or all."""
    say(db, robot, "clear_fault", {"fault": fault})


@fault_command.command("kinds")
@json_option
def kinds(*, as_json: bool) -> None:
    """List the kinds of faults, and what --amount means for each."""
    from msbot_school.faults.fault_kinds import KINDS

    if as_json:
        click.echo(
            json.dumps(
                {
                    "kinds": [
                        {
                            "kind": kind.name,
                            "words": kind.words,
                            "acts": kind.acts.value,
                            "at_part": kind.at_part,
                            "amount": None
                            if kind.amount is None
                            else {
                                "default": kind.amount.default,
                                "least": kind.amount.least,
                                "most": kind.amount.most,
                                "unit": kind.amount.unit,
                                "words": kind.amount.words,
                            },
                            "options": sorted(kind.options),
                        }
                        for kind in KINDS.values()
                    ]
                }
            )
        )
        return
    print_table(("fault", "acts", "what goes wrong"), [_kind_row(kind) for kind in KINDS.values()])


def _kind_row(kind: FaultKind) -> tuple[str, str, str]:
    amount = kind.amount
    strength = "" if amount is None else f"; --amount {amount.default:g} {amount.unit} {amount.words}"
    more = "".join(f", --{option}" for option in sorted(kind.options))
    return f"{kind.name}{' SLOT' if kind.at_part else ''}", kind.acts.value, f"{kind.words}{strength}{more}"


def _row(fault: Mapping[str, Any]) -> tuple[str, ...]:
    number, words = str(fault["number"]), str(fault["words"])
    if fault.get("concealed"):
        return number, "-", "-", words
    if fault["active"]:
        state = f"there for {fault['since_s']:.0f} s, {fault['left_s']:.0f} s left"
    elif fault["begins_in_s"] is not None:
        state = f"begins in {fault['begins_in_s']:.0f} s"
    else:
        state = f"waits{' until ' + str(fault['when']) if fault['when'] else ' for its chance'}"
    return number, str(fault["who"]), f"{state}{', hidden' if fault['hidden'] else ''}", words


# `msbot quiz`: decode it yourself.


LONGEST_ANSWER = 1000
"""Characters of an answer that are read: standard input may have no line break."""


@click.command("quiz")
@click.option("--count", type=WholeRange(1, 1000), default=5, show_default=True, help="How many questions.")
@click.option("--seed", type=WholeRange(), help="Seed: the same questions for everybody in a class.")
@json_option
def quiz_command(*, count: int, seed: int | None, as_json: bool) -> None:
    """Ask questions about messages and frames, and explain each answer.

    Status 1 unless all answers are right. With --json, answers are read from standard input, a line each; the
    result is an object.
    """
    from msbot_school.quiz import questions

    seed = SystemRandom().randrange(1_000_000) if seed is None else seed
    results = []
    if not as_json:
        click.echo(
            f"{amount(count, 'question')}; `msbot quiz --seed {seed}` asks the same again. "
            "An empty line means: I do not know."
        )
    for number, question in enumerate(islice(questions(seed), count), 1):
        if as_json:
            given = sys.stdin.readline(LONGEST_ANSWER).strip()
        else:
            click.echo(f"\n{number}. {question.text}\n   {question.shown}")
            given = click.prompt("  ", default="", show_default=False, prompt_suffix="> ")
        right = question.is_right(given)
        if not as_json:
            click.echo(f"   {'Right' if right else f'No: {question.answer}'}: {question.why}")
        results.append(
            {
                "shown": question.shown,
                "question": question.text,
                "given": given,
                "right": right,
                "answer": question.answer,
                "why": question.why,
            }
        )
    score = sum(bool(result["right"]) for result in results)
    if as_json:
        click.echo(json.dumps({"seed": seed, "right": score, "of": count, "questions": results}))
    else:
        click.echo(f"\n{score} of {count} are right.")
    sys.exit(ExitStatus.DONE if score == count else ExitStatus.NO)
