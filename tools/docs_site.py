"""Builds the site of the docs, with a page for each public face of the packages; fails at the first warning.

    .venv/bin/python tools/docs_site.py site        (or: make docs)

The pages of the faces are made from `__all__` and the docstrings. They are no part of `docs/`: the handbook on a
robot's page is for people in a classroom. Nor are the files of the robot that runs in a visitor's tab
(`tools/tab_site.py`).
"""

from __future__ import annotations

import importlib
import json
import re
import shutil
import subprocess
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

from tools.assets import FetchError
from tools.sources import PACKAGES, ROOT
from tools.tab_site import build_tab, missing_files, with_robot

FACES = {
    "msbot": "Parts in Python: what a program imports",
    "msbot.testing": "Tests of parts, in virtual time",
    "msbot_xrce": "The protocol core, without I/O",
    "msbot_agent": "The agent",
    "msbot_agent.agent": "The agent: settings, figures, sessions",
    "msbot_agent.link": "Links",
    "msbot_agent.space": "Data spaces",
}
"""The public faces: what `docs/reference/stability.md` promises to keep."""
FOR_EXTENSIONS = {
    "msbot.hardware": "Drivers",
    "msbot.doctor": "Checks of the doctor",
    "msbot_agent.cli.command_services": "Services beside a master or an agent",
    "msbot_bridges.bridge": "Worlds of other makers' devices",
    "msbot_school.faults": "Faults",
    "msbot_web": "Pages",
}
"""Faces whose classes `docs/howto/write_an_extension.md` names."""
ALL = FACES | FOR_EXTENSIONS
SOURCE = ROOT / "build" / "docs-site"


def api_page(face: str) -> str:
    """The page of one face."""
    module = importlib.import_module(face)
    lines = [f"# {face}", "", f"{ALL[face]}. `from {face} import ...`", ""]
    for name in sorted(module.__all__, key=str.casefold):
        lines += [f"::: {place_of(face, name)}", "    options:", f"      heading: {name}", ""]
    return "\n".join(lines)


def place_of(face: str, name: str) -> str:
    """Where a name is defined: a face of lazy names only passes it on."""
    found = getattr(importlib.import_module(face), name)
    module, own = getattr(found, "__module__", None), getattr(found, "__qualname__", None)
    if isinstance(module, str) and own == name and module.partition(".")[0] in {path.name for path in PACKAGES}:
        return f"{module}.{name}"
    return f"{face}.{name}"


def config() -> str:
    """mkdocs.yml with these pages, for the copy of the docs."""
    text = (ROOT / "mkdocs.yml").read_text("utf-8")
    text = re.sub(r"^docs_dir: .*$", "docs_dir: docs", text, flags=re.MULTILINE)
    text = re.sub(r"^site_dir: .*$", "site_dir: site", text, flags=re.MULTILINE)
    pages = "".join(f"      - {face}: api/{face}.md\n" for face in FACES)
    others = "".join(f"      - {face}: api/{face}.md\n" for face in FOR_EXTENSIONS)
    paths = json.dumps([str(package.parent) for package in PACKAGES])
    return f"""{text.rstrip()}
  - API:
{pages}  - API for extensions:
{others}plugins:
  - mkdocstrings:
      handlers:
        python:
          paths: {paths}
          options:
            show_source: false
            show_root_heading: true
            show_root_full_path: false
            show_bases: false
            members_order: source
            separate_signature: true
            show_signature_annotations: true
            docstring_style: google
            heading_level: 2
"""


def main(site: str) -> int:
    """Build; returns the status, 1 if there was a warning."""
    shutil.rmtree(SOURCE, ignore_errors=True)
    shutil.copytree(ROOT / "docs", SOURCE / "docs")
    (SOURCE / "docs" / "api").mkdir()
    for face in ALL:
        (SOURCE / "docs" / "api" / f"{face}.md").write_text(api_page(face), "utf-8")
    try:
        octets = build_tab(SOURCE / "docs" / "tab")
    except FetchError as error:
        sys.stderr.write(f"docs: {error}\n")
        return 1
    page = SOURCE / "docs" / "tutorial" / "try_in_this_tab.md"
    page.write_text(with_robot(page.read_text("utf-8"), octets), "utf-8")
    (SOURCE / "mkdocs.yml").write_text(config(), "utf-8")
    command = [
        str(Path(sys.executable).parent / "zensical"),
        "build",
        "--clean",
        "--config-file",
        str(SOURCE / "mkdocs.yml"),
    ]
    done = subprocess.run(command, cwd=SOURCE, capture_output=True, text=True, check=False)
    said = re.sub(r"\x1b\[[0-9;]*m", "", done.stdout + done.stderr)
    sys.stderr.write(said)
    if done.returncode or re.search(r"\bwarning\b|^griffe: ", said, re.IGNORECASE | re.MULTILINE):
        sys.stderr.write("docs: the site has warnings; they are above\n")
        return 1
    if missing := missing_files(SOURCE / "site" / "tutorial" / "try_in_this_tab" / "index.html"):
        sys.stderr.write(f"docs: the page of the robot in the tab does not find {', '.join(missing)}\n")
        return 1
    shutil.rmtree(site, ignore_errors=True)
    shutil.move(SOURCE / "site", site)
    return 0


if __name__ == "__main__":
    raise SystemExit(main(*sys.argv[1:]))
