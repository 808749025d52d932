"""robot.toml and part types as people write them: any text is a blueprint, or a ConfigError names the file."""

from __future__ import annotations

import tempfile
from collections.abc import Iterable
from functools import cache
from pathlib import Path
from random import Random

from fuzz.case import Case, Step, Violation, plain
from fuzz.mutate import mutate_octets
from msbot.config import SAMPLE_ROBOT_TOML, Library, load_blueprint, load_library
from msbot_xrce.errors import ConfigError

LIBRARY = Path(__file__).parent.parent.parent / "packages/msbot/src/msbot/config/library/types"

PIECES = (
    b"[[slot]]", b"[slot]", b"[", b"]", b"=", b'"""', b"'''", b"\\u0000", b"\\ud800", b"1e999", b"nan", b"inf", b"-1",
    b"true", b"1979-05-27", b"{a=1}", b"[[[[", b"{{", b"#", b"\r\n", b"\0", "ä".encode(), b"\xff", b"a.b.c=1",
    b"9" * 5000, b"[slot.settings]\n", b'"" = 1\n', b'part = "ABCD"\n', b'name = "AA"\n', b"[binding.x]\n",
)  # fmt: skip


class TomlTarget:
    """See the module's docstring."""

    name = "toml"
    about = "robot.toml and part types: ConfigError only, and it names the file"

    def make(self, random: Random) -> Case:
        """A sample file, changed."""
        verb = random.choice(("robot", "robot", "part"))
        samples = _samples()[verb]
        octets = random.choice(samples)
        if random.random() < 0.5:
            octets = _change_line(random, octets)
        if random.random() < 0.7:
            octets = mutate_octets(random, octets, (*samples, *PIECES))
        return (Step(verb, octets),)

    def run(self, case: Case) -> Iterable[str]:
        """Read the files."""
        seen = set()
        for step in case:
            try:
                seen.add(_read(step))
            except ConfigError as error:
                text = str(error)
                if "fuzz.toml" not in text:
                    raise Violation(f"the error does not name the file: {text[:200]}") from error
                seen.update(_without_names(line) for line in text.splitlines()[:6])
        return seen


@cache
def _samples() -> dict[str, tuple[bytes, ...]]:
    return {
        "robot": (SAMPLE_ROBOT_TOML.encode(),),
        "part": tuple(path.read_bytes() for path in sorted(LIBRARY.glob("*.toml"))),
    }


@cache
def _folder() -> tempfile.TemporaryDirectory[str]:
    return tempfile.TemporaryDirectory(prefix="msbot-fuzz-")


@cache
def _library() -> Library:
    return load_library()


def _read(step: Step) -> str:
    folder = Path(_folder().name) / step.verb
    folder.mkdir(exist_ok=True)
    path = folder / "fuzz.toml"
    path.write_bytes(step.data)
    if step.verb == "part":
        return f"library of {len(load_library(folder))}"
    blueprint = load_blueprint(path, _library())
    return f"{len(blueprint.slots)} slots, {len(blueprint.bindings)} bindings"


def _change_line(random: Random, octets: bytes) -> bytes:
    lines = octets.split(b"\n")
    for _ in range(random.choice((1, 1, 2, 4))):
        at = random.randrange(len(lines))
        match random.randrange(5):
            case 0:
                del lines[at : at + random.choice((1, 1, 3))]
            case 1:
                lines.insert(at, random.choice(lines))
            case 2:
                lines.insert(at, random.choice(PIECES))
            case 3:
                key, equals, _ = lines[at].partition(b"=")
                lines[at] = key + equals + b" " + random.choice(PIECES)
            case 4:
                other = random.randrange(len(lines))
                lines[at], lines[other] = lines[other], lines[at]
        lines = lines or [b""]
    return b"\n".join(lines)


def _without_names(line: str) -> str:
    return plain(line.rpartition("fuzz.toml")[2], 50)
