"""Writes the list in docs/reference/whose_part_fits.md from the tables of the worlds that are installed.

python tools/fits_table.py           writes it
python tools/fits_table.py --check   says whether it is up to date (status 1 if not); a test does the same
"""

from __future__ import annotations

import sys
from pathlib import Path

from msbot_agent.text.sentence import Sentence
from msbot_bridges.bridge import Fit, worlds

PAGE = Path(__file__).parents[1] / "docs" / "reference" / "whose_part_fits.md"
BEGIN = "<!-- made by tools/fits_table.py -->\n"
END = "<!-- end of what is made -->\n"
MESSAGES = ("Speed", "Angle", "Level", "Distance", "Switch", "Battery")


def table() -> str:
    """A line for each message."""
    fits = {name: {one.message: one for one in kind.fits()} for name, kind in sorted(worlds().items())}
    lines = []
    for message in MESSAGES:
        found = [f"{name}: {_words(fit[message])}" for name, fit in fits.items() if message in fit]
        lines.append(f"* `{message}` {'; '.join(found)}")
    return "\n".join(lines) + "\n"


def _words(fit: Fit) -> str:
    """Kinds of devices; units are left out, each world has the usual ones."""
    kinds = dict.fromkeys(_plain(kind) for kind in (*fit.reports, *fit.driven))
    return ", ".join(kinds)


def _plain(kind: str) -> str:
    return kind.form.partition(" in {")[0] if isinstance(kind, Sentence) else kind


def page() -> str:
    """The page as it should be."""
    before, _, rest = PAGE.read_text("utf-8").partition(BEGIN)
    return before + BEGIN + table() + END + rest.partition(END)[2]


def main() -> int:
    """Write the page, or compare it."""
    made = page()
    if "--check" in sys.argv[1:]:
        return int(made != PAGE.read_text("utf-8"))
    PAGE.write_text(made, encoding="utf-8")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
