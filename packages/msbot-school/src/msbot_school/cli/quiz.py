"""`msbot quiz`: decode it yourself."""

from __future__ import annotations

import json
import sys
from itertools import islice
from random import SystemRandom

import click

from msbot_agent.cli.numbers import WholeRange
from msbot_agent.cli.options import json_option
from msbot_xrce.common.amount import amount

LONGEST_ANSWER = 1000
"""Characters of an answer that are read: standard input may have no line break."""


@click.command("quiz")
@click.option("--count", type=WholeRange(1, 1000), default=5, show_default=True, help="How many questions.")
@click.option("--seed", type=WholeRange(), help="The same questions again: everybody in a class gets these.")
@json_option
def command(*, count: int, seed: int | None, as_json: bool) -> None:
    """Ask questions about messages and frames, and say after each answer how one finds it.

    Status 1 unless all answers are right. With --json nothing is asked at the terminal: answers come as lines on
    standard input, the result is an object.
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
        results.append({"shown": question.shown, "question": question.text, "given": given, "right": right,
                        "answer": question.answer, "why": question.why})  # fmt: skip
    score = sum(bool(result["right"]) for result in results)
    if as_json:
        click.echo(json.dumps({"seed": seed, "right": score, "of": count, "questions": results}))
    else:
        click.echo(f"\n{score} of {count} are right.")
    sys.exit(0 if score == count else 1)
