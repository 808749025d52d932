"""Keeps the catalogues of languages in step with the program, for translators.

    python tools/catalogue.py            adds what the program says, and shows what has no translation yet
    python tools/catalogue.py --new fr   begins a language: one file, packages/msbot-web/src/msbot_web/languages/fr.po

The files are gettext PO, as Poedit, Weblate and other translators' tools read and write them. The text to translate is
the English one; what has no translation shows in English. Words in braces are replaced by values and stay as they are.
"""

from __future__ import annotations

import argparse
import ast
import re
import sys
from collections.abc import Mapping
from pathlib import Path

import polib

sys.path.insert(0, str(Path(__file__).parents[1]))

import msbot_agent
import msbot_bridges
import msbot_web
from msbot.config import SAMPLES, load_library
from msbot.config.blueprint.class_robot import GROUP_ROBOT_TOML
from msbot.operations.rights import Right, Role
from msbot.part.join.home import Home
from msbot.part.join.refusal import Refusal
from msbot.pnp import PartState, inventory_record, packet_words
from msbot_web.pages.program_words import PART_SAYS
from tools.sources import source_files

FOLDER = Path(str(msbot_web.__path__[0])) / "languages"
MAKERS = Path(str(msbot_bridges.__path__[0])) / "makers" / "robot.toml"
OF_ANY_LANGUAGE = {"800 kbit/s", "9600 bit/s", "8 bit", "10 bit", "16 bit", "24 bit"}
COMPLETE = FOLDER / "de.po"
"""Comes with each change of the program, so it also has texts that are not found here, such as those of missions."""
MOST_SHOWN = 40
"""Texts without a translation, of one language."""


def main(*arguments: str) -> int:
    """Update all catalogues, or begin one."""
    options = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    options.add_argument("--new", metavar="CODE", help="begin a language: its code as in RFC 5646")
    chosen = options.parse_args(arguments)
    if chosen.new:
        path = FOLDER / f"{chosen.new}.po"
        if path.exists():
            sys.exit(f"{path} is there already")
        catalogue = polib.POFile(wrapwidth=0)
        catalogue.metadata = {
            "Project-Id-Version": "msbot",
            "Language": chosen.new,
            "MIME-Version": "1.0",
            "Content-Type": "text/plain; charset=UTF-8",
            "Content-Transfer-Encoding": "8bit",
            "X-Language-Name": chosen.new,
            "X-Decimal": ".",
            "X-Thousands": ",",
        }
        catalogue.save(str(path))
    texts = everything()
    for path in sorted(FOLDER.glob("*.po")):
        added, left = update(path, texts)
        sys.stdout.write(f"{path.name}: {added} texts added, {len(left)} without a translation\n")
        sys.stdout.writelines(f"    {text}\n" for text in left[:MOST_SHOWN])
        if len(left) > MOST_SHOWN:
            sys.stdout.write(f"    and {len(left) - MOST_SHOWN} more\n")
    return 0


def update(path: Path, everything: Mapping[str, set[str]]) -> tuple[int, list[str]]:
    """Add the texts that a catalogue lacks; returns how many, and those without a translation."""
    catalogue = polib.pofile(str(path), wrapwidth=0)
    known = {entry.msgid for entry in catalogue}
    added = 0
    for comment, texts in everything.items():
        for text in sorted(texts - known):
            flags = ["python-brace-format"] if "{" in text else []
            catalogue.append(polib.POEntry(msgid=text, msgstr="", comment=comment, flags=flags))
            known.add(text)
            added += 1
    catalogue.save(str(path))
    return added, [entry.msgid for entry in catalogue.untranslated_entries()]


def everything() -> dict[str, set[str]]:
    """All texts that this finds in the program or in the complete catalogue, by where a person reads them."""
    found = {
        "The page.": texts_of_the_pages(),
        "What the robot says.": sentences_of_the_robot() | losses_of_the_links(),
        "The part library.": texts_of_the_library(),
    }
    for entry in polib.pofile(str(COMPLETE)):
        found.setdefault(entry.comment, set()).add(entry.msgid)
    return found


def texts_of_the_pages() -> set[str]:
    """Every text that `translate` (or `say`, as functions call it) gets as it stands, titles of pages, and the help."""
    found = set()
    package = Path(str(msbot_web.__path__[0]))
    for path in (path for path in package.rglob("*.py") if not path.is_relative_to(package / "cli")):
        for node in ast.walk(ast.parse(path.read_text())):
            if not isinstance(node, ast.Call):
                continue
            called = node.func.attr if isinstance(node.func, ast.Attribute) else getattr(node.func, "id", "")
            if called in ("say", "translate") and node.args and not isinstance(node.args[0], ast.Call | ast.Dict):
                found |= _strings(node.args[0])
            elif called == "count" and len(node.args) > 2:
                found |= {text for form in node.args[1:3] for text in _strings(form)}
            elif called == "MenuEntry":
                found |= _strings(node.args[2])
            elif called == "page_frame":
                found |= _strings(node.args[3])
            elif called in ("PageHelp", "TourStep"):
                found |= _strings(node.args[0])
    found |= set(PART_SAYS)
    for path in (Path(str(msbot_web.__path__[0])) / "templates").glob("*.html"):
        found |= set(re.findall(r'\b(?:say|translate)\("([^"]+)"', path.read_text()))
    return found


def _strings(node: ast.AST) -> set[str]:
    return {leaf.value for leaf in ast.walk(node) if isinstance(leaf, ast.Constant) and isinstance(leaf.value, str)}


def sentences_of_the_robot() -> set[str]:
    """Every form that rooms make sentences of, and the words of states, refusals, roles and rights."""
    found = {word.value for word in PartState} | {refusal.describe for refusal in Refusal}
    found |= {refusal.name.lower().replace("_", " ") for refusal in Refusal}
    found |= {*packet_words.FORMS, *inventory_record.FORMS, *(home.label for home in Home)}
    found |= {words for role in Role for words in (role.word, role.with_article)} | {right.value for right in Right}
    for path in source_files():
        for node in ast.walk(ast.parse(path.read_text())):
            called = node.func.id if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) else ""
            if isinstance(node, ast.Call) and called in ("said", "counted"):
                forms = node.args[:1] if called == "said" else node.args[1:]
                found |= {text for form in forms for text in _forms(form)}
    return {form for form in found if re.search("[A-Za-z]{2}", re.sub("{[^}]*}", "", form))}


def _forms(node: ast.AST) -> set[str]:
    """The text that stands there, or the two that are chosen from."""
    if isinstance(node, ast.IfExp):
        return _forms(node.body) | _forms(node.orelse)
    return {node.value} if isinstance(node, ast.Constant) and isinstance(node.value, str) else set()


def losses_of_the_links() -> set[str]:
    """Why links drop packets, as far as it stands in their code."""
    found: set[str] = set()
    for path in (Path(str(msbot_agent.__path__[0])) / "link").rglob("*.py"):
        tree = ast.parse(path.read_text())
        names = {
            target.id: node.value
            for node in tree.body
            if isinstance(node, ast.Assign | ast.AnnAssign) and node.value is not None
            for target in (node.targets if isinstance(node, ast.Assign) else [node.target])
            if isinstance(target, ast.Name)
        }
        for node in ast.walk(tree):
            if isinstance(node, ast.Call) and ast.unparse(node.func).endswith("dropped.count"):
                why = node.args[0]
                for one in (why.body, why.orelse) if isinstance(why, ast.IfExp) else (why,):
                    found |= _forms(names.get(one.id, one) if isinstance(one, ast.Name) else one)
        found |= {text for name in ("NOT_SENT", "BUS_LEFT") if name in names for text in _forms(names[name])}
    return found


def texts_of_the_library() -> set[str]:
    """What the library says of its part types, and sample robots of their slots, as far as it holds words."""
    library = load_library()
    found = {message.description for message in library.messages.values()}
    for robot in (*SAMPLES.values(), GROUP_ROBOT_TOML, MAKERS.read_text("utf-8")):
        found |= set(re.findall(r'^description = "([^"]*)"$', robot, re.MULTILINE))
    for entry in library:
        found |= {entry.name, entry.description, entry.resolution, entry.connector, entry.specification}
        found |= {entry.driver.none}
        found |= {port.description for port in entry.ports} | {pin.description for pin in entry.pins}
        found |= {one.description for one in entry.parameters} | {wire.description for wire in entry.driver.pins}
        if entry.simulator is not None:
            found |= {one.words for one in entry.simulator.controls}
            found |= {one.words for one in entry.simulator.readings if one.shown}
    return {text for text in found if re.search("[a-z]{3}", text)} - OF_ANY_LANGUAGE


if __name__ == "__main__":
    raise SystemExit(main(*sys.argv[1:]))
