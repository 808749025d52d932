"""Quiz: take octets and frames apart yourself, made up ones or those of the robot's bus; graded."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import islice
from random import Random, SystemRandom
from typing import Final

from fastapi import Request
from nicegui import ui

from msbot_agent.link.can.protocol import parse_frame
from msbot_school.quiz import Question, frame_question, questions
from msbot_web.html import render
from msbot_web.models.bus_models import FrameLine
from msbot_web.pages.layout import page_frame
from msbot_web.pages.page import Page
from msbot_web.pages.page_elements import panel
from msbot_web.service import Service
from msbot_xrce.errors import LocalProtocolError

ROWS: Final = 60
"""Frames of the bus of which one is drawn."""
MOST_SEED: Final = 1_000_000
MOST_PAST: Final = 1_000
"""Questions that an address may say are over."""
MADE_UP: Final = "made"
OF_THE_BUS: Final = "bus"


def register(service: Service) -> None:
    """Make the page known."""

    @ui.page("/learn/quiz")
    def quiz(request: Request, seed: str = "", past: str = "", asked: str = "", right: str = "") -> None:
        with page_frame(service, request, "/learn", "Quiz") as page:
            given = _count(seed, 999_999_999)
            _Quiz(
                page,
                SystemRandom().randrange(MOST_SEED) if given is None else given,
                _count(past, MOST_PAST) or 0,
                _count(asked, MOST_PAST) or 0,
                _count(right, MOST_PAST) or 0,
            )


def _count(text: str, most: int) -> int | None:
    """The number that an address says; None: it says none."""
    return int(text) if text.isascii() and text.isdigit() and len(text) < 10 and int(text) <= most else None


class _Quiz:
    """One person's questions; nobody else sees the answers, and they are forgotten when the page is left.

    How far the person is stands in the address, so that a page that is loaded again (after the connection was lost
    for long, or the robot has started anew) goes on where it was.

    Args:
        page: where it is.
        seed: of the made-up questions.
        past: how many of these are behind the person.
        asked: how many questions have been graded.
        right: how many of them were right.
    """

    def __init__(self, page: Page, seed: int, past: int, asked: int, right: int) -> None:
        self._page = page
        self._seed = seed
        self._made = islice(questions(seed), past, None)
        self._past = past
        self._random = Random(seed)
        self._question: Question | None = None
        self._row: FrameLine | None = None
        self._asked = asked
        self._right = min(right, asked)
        say = page.translate
        with panel().style("display:flex;flex-direction:column;gap:.6rem;max-width:60rem"):
            with ui.element("div").classes("row spread"):
                sources = {MADE_UP: say("random")}
                if page.sight.bus().watched:
                    sources[OF_THE_BUS] = say("from this robot's bus")
                self._source = ui.select(sources, value=MADE_UP, label=say("Bytes and frames"))
                self._source.props("dense outlined").style("min-width:min(14rem,100%)").on_value_change(self._ask)
                self._score = ui.label("").props("role=status").style("font-weight:600")
            self._shown = ui.html("", sanitize=False).classes("w-full")
            self._answer = (
                ui.input(say("Your answer")).props("dense outlined autocomplete=off").style("max-width:24rem")
            )
            self._answer.on("keydown.enter", self._check)
            with ui.element("div").classes("row"):
                self._buttons = [
                    ui.button(say("Check"), icon="check", on_click=self._check),
                    ui.button(say("I do not know"), on_click=self._give_up).props("outline"),
                ]
                self._next = ui.button(say("Next question"), icon="arrow_forward", on_click=self._go_on)
            self._result = ui.html("", sanitize=False).classes("w-full").props("role=status aria-live=polite")
            ui.label(
                say(
                    "Seed {seed}: who opens {address} gets the same random questions.",
                    seed=seed,
                    address=f"/learn/quiz?seed={seed}",
                )
            ).classes("soft")
        self._ask()

    def _ask(self) -> None:
        self._row, self._question = None, None
        if self._source.value == OF_THE_BUS:
            self._row, self._question = _of_the_bus(
                [row for row in self._page.frame_lines(ROWS) if row.notation], self._random
            )
        else:
            self._question = next(self._made)
        say = self._page.translate
        self._shown.set_content(render("quiz_question", say=say, question=self._question))
        self._result.set_content("")
        self._answer.set_value("")
        self._let_answer(self._question is not None)
        self._note_place()

    def _let_answer(self, can_answer: bool) -> None:
        """Either a question is open, or the next one can be had."""
        self._answer.set_enabled(can_answer)
        for button in self._buttons:
            button.set_visibility(can_answer)
        self._next.set_visibility(not can_answer)
        self._score.set_text(
            self._page.translate("{right} of {asked} are right", right=self._right, asked=self._asked)
            if self._asked
            else ""
        )

    def _note_place(self) -> None:
        """Let the address say how far the person is."""
        address = f"/learn/quiz?seed={self._seed}"
        if self._past or self._asked:
            address += f"&past={self._past}&asked={self._asked}&right={self._right}"
        ui.run_javascript(f"history.replaceState(history.state, '', msbotAt('{address}'))")

    def _check(self) -> None:
        given = str(self._answer.value or "").strip()
        if not given:
            ui.notify(self._page.translate("Write an answer first, or say that you do not know."), type="warning")
            return
        self._grade(given)

    def _give_up(self) -> None:
        self._grade("")

    def _grade(self, given: str) -> None:
        question = self._question
        if question is None or not self._buttons[0].visible:
            return  # pressed twice
        is_right = question.is_right(given)
        self._asked += 1
        self._right += is_right
        self._result.set_content(
            render("quiz_result", say=self._page.translate, question=question, is_right=is_right, row=self._row)
        )
        self._let_answer(False)
        self._past += self._row is None  # a question about the bus is none of the made-up ones
        self._note_place()
        ui.run_javascript(f"setTimeout(() => getElement({self._next.id}).$el.focus(), 50)")

    def _go_on(self) -> None:
        self._ask()
        if self._question is not None:
            self._answer.run_method("focus")


def _of_the_bus(rows: Sequence[FrameLine], random: Random) -> tuple[FrameLine | None, Question | None]:
    """A question about one of the latest frames; None: no frame has come about which something is asked."""
    drawn = random.sample(rows, len(rows))
    for row in sorted(drawn, key=lambda row: not (row.plain or row.about)):  # best one whose meaning can be told
        try:
            question = frame_question(parse_frame(row.notation), random)
        except (ValueError, LocalProtocolError):  # an error frame
            continue
        if question is not None:
            return row, question
    return None, None
