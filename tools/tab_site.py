"""The files of the docs' page "Try it in this tab": Python for the browser (Pyodide), MsBOT's packages, and the page's
own scripts. `tools/docs_site.py` puts them into the site; everything is loaded from the site itself.
"""

from __future__ import annotations

import json
import re
import shutil
import zipfile
from pathlib import Path

from tools.assets import stored
from tools.sources import ROOT

PAGE = ROOT / "tools" / "tab_page"
SCRIPTS = ("tab.js", "tab.css", "worker.js")
FILES = ("../tab/tab.css", "../tab/tab.js")
"""What the page loads, from where its text is in the docs; the site's builder makes addresses of it."""
DISTRIBUTIONS = ("msbot-xrce", "msbot-agent", "msbot", "msbot-school")
"""What a robot in a tab consists of, without libraries of others."""
ENDINGS = (".py", ".toml")
DATE = (1980, 1, 1, 0, 0, 0)
"""Of every file in the archive: the same sources make the same archive."""
MARK = '<div id="tab-robot">'
END = "</div>"
"""What stands between them in the page is shown where the robot is not, as in the handbook."""
NOTICE = """\
pyodide/: {package} {version}, {licence}, unmodified. Its source: {home}
It contains Python, whose licence is the PSF's (https://docs.python.org/3/license.html).
All other files here are MsBOT's: Apache-2.0.
"""


def build_tab(into: Path) -> int:
    """Write the files into a folder; returns how many octets a visitor loads.

    Raises:
        FetchError: Pyodide is not to be had.
    """
    pyodide = stored("pyodide")
    shutil.rmtree(into, ignore_errors=True)
    (into / "pyodide").mkdir(parents=True)
    for name, octets in pyodide.items():
        (into / "pyodide" / name).write_bytes(octets)
    _pack(into / "msbot.zip")
    for name in SCRIPTS:
        shutil.copy(PAGE / name, into / name)
    manifest = json.loads((PAGE / "manifest.json").read_text("utf-8"))
    (into / "NOTICE.txt").write_text(NOTICE.format(**manifest), "utf-8")
    return sum(path.stat().st_size for path in into.rglob("*") if path.is_file())


def with_robot(page: str, octets: int) -> str:
    """The page with its robot in place of what is shown where there is none."""
    before, mark, rest = page.partition(MARK)
    _, end, after = rest.partition(END)
    if not mark or not end:
        raise ValueError(f"the page has no {MARK} ... {END} for the robot")
    size = f"{octets / 1e6:.0f}"
    robot = f'<div id="tab-robot" data-megabytes="{size}">The robot needs JavaScript.</div>'
    files = f'<link rel="stylesheet" href="{FILES[0]}"><script defer src="{FILES[1]}"></script>'
    return f"{before}{robot}\n{files}{after}"


def missing_files(page: Path) -> list[str]:
    """Which of its own files a finished page would not find, by where it looks for them; all, if it names none."""
    named = re.findall(r'(?:src|href)="([^"]*/tab/[^"/]+)"', page.read_text("utf-8"))
    return [name for name in named if not (page.parent / name).is_file()] if len(named) == len(FILES) else [*FILES]


def _pack(path: Path) -> None:
    found = {
        source.relative_to(root).as_posix(): source
        for root in (ROOT / "packages" / name / "src" for name in DISTRIBUTIONS)
        for source in root.rglob("*")
        if source.suffix in ENDINGS
    }
    found["tab_start.py"] = PAGE / "tab_start.py"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED, compresslevel=9) as archive:
        for name, source in sorted(found.items()):
            archive.writestr(zipfile.ZipInfo(name, DATE), source.read_bytes(), zipfile.ZIP_DEFLATED, 9)
