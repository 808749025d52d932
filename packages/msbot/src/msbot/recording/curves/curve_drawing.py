"""Curves as letters for a terminal (plotext), and as a picture (matplotlib): the extra `msbot[plot]`."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import Final

from msbot.recording.curves.curve import Curve, Figures, thinned
from msbot_xrce.errors import ConfigError

COLOURS: Final = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#7F7F7F", "#000000")
"""Okabe and Ito's, which people tell apart who see few colours."""
TERMINAL_COLOURS: Final = ("blue", "yellow", "green", "magenta", "red", "cyan")
PICTURES: Final = (".png", ".svg", ".pdf")
MOST_DRAWN: Final = 4000
"""Points of a curve in a picture."""
_SIGNS: Final = re.compile(r"\x1b\[[0-9;]*m")


def by_unit(curves: Sequence[Curve]) -> Mapping[str, list[Curve]]:
    """The curves that share an axis, in the order of the first of each."""
    found: dict[str, list[Curve]] = {}
    for curve in curves:
        found.setdefault(curve.unit, []).append(curve)
    return found


def axis_words(curves: Sequence[Curve]) -> str:
    """What stands at an axis: the unit; of a single curve its name, too."""
    unit = f"[{curves[0].unit}]" if curves[0].unit else ""
    return f"{curves[0].name} {unit}".strip() if len(curves) == 1 else unit


def figure_rows(curves: Sequence[Curve], figures: Mapping[str, Figures]) -> list[tuple[str, ...]]:
    """A table: name, values, mean, least, greatest, last, unit."""
    rows: list[tuple[str, ...]] = []
    for curve in curves:
        found = figures.get(curve.name)
        if found is not None:
            numbers = (found.mean, found.least, found.most, curve.points[-1][1])
            rows.append((curve.name, str(found.count), *(f"{number:.5g}" for number in numbers), curve.unit))
    return rows


def terminal_plot(curves: Sequence[Curve], *, zero_s: float, width: int, height: int, colour: bool) -> str:
    """The curves as lines of text, one chart for each unit, below each other.

    Args:
        curves: their times in seconds.
        zero_s: the time that the axis calls 0.
        width: letters in a line.
        height: lines in all.
        colour: with the signs that colour letters in a terminal.
    """
    plotext = _library("plotext")
    number = {curve.name: place for place, curve in enumerate(curves)}
    groups = by_unit(curves)
    each = max(height // len(groups), 8)
    ends = [at - zero_s for curve in curves for at, _ in (curve.points[0], curve.points[-1])]
    pieces = []
    for unit, group in groups.items():
        plotext.clear_figure()
        plotext.theme("clear")
        plotext.plotsize(width, each)
        for curve in group:
            points = thinned(curve.points, 4 * width)
            # Colours tell the curves apart, and the table below has them too; without colours it is letters.
            plotext.plot(
                [at - zero_s for at, _ in points],
                [value for _, value in points],
                color=f"{terminal_colour(number[curve.name])}+" if colour else None,
                marker="braille" if colour or len(group) == 1 else terminal_letter(number[curve.name]),
            )
        plotext.xlim(min(ends), max(ends) if max(ends) > min(ends) else min(ends) + 1)
        plotext.ylabel(axis_words(group) or unit)
        plotext.xlabel("s")
        pieces.append(plotext.build())
    plotext.clear_figure()
    text = "\n".join(pieces)
    return text if colour else _SIGNS.sub("", text)


def terminal_colour(number: int) -> str:
    """The colour of a curve in a terminal."""
    return TERMINAL_COLOURS[number % len(TERMINAL_COLOURS)]


def terminal_letter(number: int) -> str:
    """The letter of a curve in a terminal without colours."""
    return chr(ord("a") + number % 26)


def save_picture(curves: Sequence[Curve], target: Path, *, zero_s: float, title: str) -> None:
    """The curves as a picture, one chart for each unit, with a common axis of time.

    Raises:
        ConfigError: the file cannot be written, or what draws is not installed.
    """
    _library("matplotlib")
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    groups = by_unit(curves)
    figure = Figure(figsize=(10, max(2.2 * len(groups) + 1, 4)), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots(len(groups), 1, sharex=True, squeeze=False)[:, 0]
    number = 0
    for place, group in zip(axes, groups.values(), strict=True):
        for curve in group:
            points = thinned(curve.points, MOST_DRAWN)
            place.plot(
                [at - zero_s for at, _ in points],
                [value for _, value in points],
                label=curve.name,
                color=COLOURS[number % len(COLOURS)],
                linestyle=("-", "--", ":")[number // len(COLOURS) % 3],
                linewidth=1.4,
            )
            number += 1
        place.set_ylabel(axis_words(group).replace("$", r"\$"))
        place.grid(visible=True, alpha=0.3)
        if len(curves) > 1:
            place.legend(loc="upper left", bbox_to_anchor=(1, 1), frameon=False)
    axes[-1].set_xlabel("time [s]")
    figure.suptitle(title.replace("$", r"\$"))
    try:
        figure.savefig(target, dpi=120)
    except OSError as error:
        raise ConfigError(f"cannot write {target}: {error.strerror or error}") from None


def _library(name: str) -> ModuleType:
    try:
        return import_module(name)
    except ImportError:
        raise ConfigError(f"drawing curves needs {name}: install it with `pip install 'msbot[plot]'`") from None
