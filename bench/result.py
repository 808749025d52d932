"""Where measurements are kept: bench/results/NAME.md, written by the script that took them and by nothing else.

The docs cite a figure and name the file; so a page of the docs never holds a table that a script would have to find.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

FOLDER = Path(__file__).parent / "results"


def write_result(name: str, title: str, lines: Sequence[str], *, made_by: str) -> Path:
    """Write a table.

    Args:
        name: the file's name without `.md`.
        title: its heading.
        lines: the table in Markdown, with the machine and the date.
        made_by: the command that prints it again, seen from the project's folder.

    Returns:
        The file that was written.
    """
    FOLDER.mkdir(exist_ok=True)
    path = FOLDER / f"{name}.md"
    path.write_text(f"# {title}\n\nMade by `{made_by}`.\n\n" + "\n".join(lines).strip() + "\n", "utf-8")
    return path
