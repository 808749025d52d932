"""The console of a simulated part: what it says, and what a person may type."""

from __future__ import annotations

import asyncio
import io
import os
import pty
from dataclasses import replace

import pytest

from msbot.cli.run.part import MOST_TYPED, PartConsole, _is_ours, apply_settings
from msbot.sim import make_simulator
from msbot_xrce.errors import ConfigError
from tests.sim.robot import LIBRARY, Bench, play


def test_controls_are_set_from_texts() -> None:
    unit = make_simulator("KY-023", library=LIBRARY)
    apply_settings(unit, ["left_right=50", " press = yes "])
    assert (unit.value("left_right"), unit.value("press")) == (50, True)


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("press", "'press' sets nothing: write CONTROL=VALUE; controls: left_right (-100 to 100 %); back_ahead"),
        ("pres=1", "part KY-023 has no control 'pres'; controls: left_right, back_ahead, press"),
        ("left_right=far", "control left_right must be a number, -100 to 100 %"),
    ],
)
def test_a_text_that_makes_no_sense_is_explained(text: str, sentence: str) -> None:
    unit = make_simulator("KY-023", library=LIBRARY)
    with pytest.raises(ConfigError) as caught:
        apply_settings(unit, [text])
    assert sentence in str(caught.value)


def test_a_part_without_controls_says_so() -> None:
    with pytest.raises(ConfigError, match="this part has no controls"):
        apply_settings(make_simulator("LED", library=LIBRARY), ["on"])


def test_changes_are_said_once_and_noise_is_no_news() -> None:
    lines: list[str] = []
    unit = make_simulator("DHT22", library=LIBRARY)
    console = PartConsole(unit, lines.append)
    for _ in range(50):
        console.print_changes()
    assert len(lines) == 1
    assert lines[0].startswith("celsius 2")
    unit = make_simulator("TOGGLE", library=LIBRARY)
    console = PartConsole(unit, lines.append)
    console.print_changes()
    console.typed("lever=on\n")
    console.typed("\n")
    console.typed("lever=maybe\n")
    assert lines[1:] == ["output false", "output true", 'control lever must be true or false; it is the text "maybe"']


def test_the_last_small_step_of_a_ramp_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    lines: list[str] = []
    unit = make_simulator("POT-10K", library=LIBRARY)
    console = PartConsole(unit, lines.append)
    name = next(name for name, value in unit.readings().items() if isinstance(value, float))
    console._readings[name] = replace(console._readings[name], noise=0.0)
    for value in (10.0, 20.0, 30.58, 30.9, 31.0, 31.0, 31.0):
        monkeypatch.setattr(unit, "readings", lambda value=value: {name: value})
        console.print_changes()
    assert [line.split()[1] for line in lines] == ["10", "20", "30.58", "31"]


def test_what_is_typed_into_a_pipe_is_done_line_by_line_until_it_is_closed() -> None:
    ours, theirs = os.pipe()
    lines: list[str] = []

    async def scene(bench: Bench) -> None:
        with os.fdopen(ours) as source, os.fdopen(theirs, "w", buffering=1) as typist:
            PartConsole(bench.unit, lines.append, source)._listen()
            for text in ("press=true\npress=", "oops\nfoo\n"):
                typist.write(text)
                typist.flush()
                await asyncio.sleep(0.2)
            typist.close()
            await asyncio.sleep(0.2)
            assert not asyncio.get_running_loop().remove_reader(source)

    play("BUTTON", scene)
    assert lines == [
        "output true",
        'control press must be true or false; it is the text "oops"',
        "'foo' sets nothing: write CONTROL=VALUE; controls: press (true, false)",
    ]


def test_a_line_without_an_end_is_not_kept() -> None:
    lines: list[str] = []
    console = PartConsole(make_simulator("BUTTON", library=LIBRARY), lines.append, io.StringIO())
    for _ in range(100):
        console.execute_lines("x" * MOST_TYPED)
    assert len(console._unfinished) == MOST_TYPED + 1
    console.execute_lines("\npress=true\n")
    assert lines == ["a line of more than 4096 characters is left out: write CONTROL=VALUE", "output true"]


def test_a_program_in_the_background_leaves_the_keyboard_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    lines: list[str] = []
    ours, theirs = pty.openpty()
    group = os.getpgrp()
    foreground = [group]
    monkeypatch.setattr(os, "tcgetpgrp", lambda _: foreground[0])

    async def scene(bench: Bench) -> None:
        with os.fdopen(theirs) as terminal:
            console = PartConsole(bench.unit, lines.append, terminal)
            foreground[0] = group + 1
            console._listen()
            assert not asyncio.get_running_loop().remove_reader(terminal)
            foreground[0] = group
            console._listen()
            os.write(ours, b"press=true\n")
            console._hear()  # as the loop does; a terminal takes its time, which virtual time does not wait for
            foreground[0] = group + 1
            os.write(ours, b"press=false\n")
            console._hear()
            assert not asyncio.get_running_loop().remove_reader(terminal)
        os.close(ours)

    play("BUTTON", scene)
    assert lines == ["output true"]


def test_a_terminal_of_somebody_else_is_read() -> None:
    ours, theirs = pty.openpty()
    with os.fdopen(theirs) as terminal:
        assert _is_ours(terminal)
    os.close(ours)
