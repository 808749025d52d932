"""`gateway.toml` and `router.toml`: what they mean, and what is said of mistakes."""

from __future__ import annotations

from pathlib import Path

import pytest

from msbot_agent.space import Qos, Topic
from msbot_agent.toml.problems import InvalidFileError
from msbot_agent.wide import BridgeDirection, read_gateway_file, read_router_file
from tests import ROOT

GUIDE = (ROOT / "docs/howto/zenoh.md").read_text()


def example(begin: str) -> str:
    """A TOML text of the guide."""
    return next(block for block in GUIDE.split("```") if block.startswith(f"toml\n{begin}")).removeprefix("toml\n")


def written(tmp_path: Path, text: str) -> Path:
    file = tmp_path / "file.toml"
    file.write_text(text)
    return file


def test_the_gateway_of_the_guide(tmp_path: Path) -> None:
    rules = read_gateway_file(written(tmp_path, example("# gateway.toml")))
    assert (rules.inside.domain, rules.outside.routers) == (7, ("tls/router.school.example:7447",))
    assert rules.outside.tls is not None
    assert rules.outside.tls.certificate == tmp_path / "north.pem"
    light, chatter = rules.crossings
    assert (light.topic, light.direction, light.robot) == (Topic("light", "Light"), BridgeDirection.OUT, "ROVER")
    assert light.qos_in(rules.inside) == Qos(depth=16, partitions=("msbot/ROVER",))
    assert light.qos_in(rules.outside) == Qos(depth=16, partitions=("ROVER",))
    assert (chatter.direction, chatter.qos.separation_s) == (BridgeDirection.BOTH, 0.1)
    assert chatter.qos_in(rules.inside).partitions == ("",)


def test_the_router_of_the_guide(tmp_path: Path) -> None:
    rules = read_router_file(written(tmp_path, example("# router.toml")))
    assert rules.listen == ("tls/0.0.0.0:7447",)
    assert rules.tls is not None
    assert rules.tls.key == tmp_path / "router.key"
    (allowed,) = rules.allowed
    assert (allowed.who, allowed.keys, allowed.sends, allowed.receives) == (
        ("north", "south"),
        ("ROVER/**",),
        True,
        True,
    )


HEAD = 'inside = "dds:7"\noutside = "zenoh"\n'
CROSS = '[[cross]]\ntopic = "a"\ntype = "A"\ndirection = "out"\n'


@pytest.mark.parametrize(
    ("text", "line", "words"),
    [
        (HEAD, 1, "nothing crosses: add a table that begins with [[cross]]"),
        (f'outside = "zenoh"\n{CROSS}', 1, "inside"),
        (f'inside = "dds:300"\noutside = "zenoh"\n{CROSS}', 1, "DDS domains go from 0 to 232"),
        (f'inside = "zenoh"\noutside = "dds"\n{CROSS}', 2, "the others are reached by Zenoh"),
        (f'inside = "zenoh"\noutside = "zenoh"\n{CROSS}', 2, "inside and outside are the same"),
        (f"{HEAD}{CROSS}kep = 1\n", 7, "there is no such key here"),
        (f"{HEAD}{CROSS}every_s = -1\n", 7, "must be 0 to 3600 s"),
        (f"{HEAD}{CROSS}keep = 20\ndepth = 5\n", 7, "is 20, and depth is 5: it cannot be more than that"),
        (HEAD + CROSS.replace("out", "up"), 6, 'is none of "out", "in", "both"'),
        (HEAD + CROSS + CROSS, 8, '"a" crosses already, by number 1 of the list'),
        (HEAD + CROSS.replace('"a"', '"rq/addRequest"'), 4, "services do not cross"),
        (HEAD + CROSS.replace('"a"', '"a*"'), 4, 'must not contain "*"'),
        (HEAD + '[[cross]]\ntopic = "a"\ndirection = "in"\n', 3, "type"),
    ],
)
def test_mistakes_in_a_gateway_file_are_told_with_their_line(tmp_path: Path, text: str, line: int, words: str) -> None:
    with pytest.raises(InvalidFileError) as caught:
        read_gateway_file(written(tmp_path, text))
    (problem,) = caught.value.problems
    assert words in str(problem)
    assert problem.place.line in (line, None)


@pytest.mark.parametrize(
    ("text", "line", "words"),
    [
        ("listen = []\n", 1, "must name at least one endpoint"),
        ('listen = ["tcp/0.0.0.0"]\n', 1, "'tcp/0.0.0.0' is no endpoint"),
        ('listen = ["tls/0.0.0.0:7447"]\n', 1, "needs certificates: add a table that begins with [tls]"),
        ('\n[[allow]]\nwho = ["north"]\n', 3, "only a certificate tells"),
        ('[[allow]]\nkeys = ["ROVER/"]\n', 2, "is no key: words with / between them"),
        ('[[allow]]\nkeys = ["RO$*"]\n', 2, "is no key"),
        ('[[allow]]\nmay = ["read"]\n', 2, 'is neither "send" nor "receive"'),
        ("port = 7\n", 1, "there is no such key here"),
    ],
)
def test_mistakes_in_a_router_file_are_told_with_their_line(tmp_path: Path, text: str, line: int, words: str) -> None:
    with pytest.raises(InvalidFileError) as caught:
        read_router_file(written(tmp_path, text))
    (problem,) = caught.value.problems
    assert words in str(problem)
    assert problem.place.line == line
