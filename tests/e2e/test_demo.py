"""The promises of `msbot demo`, kept in real time, by the command itself."""

import json
import re
import signal
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from subprocess import CompletedProcess

import pytest

from tests.e2e.processes import run, running

Json = dict[str, object]
Ends = dict[tuple[str, str], Callable[[], CompletedProcess[str]]]
LINKS = ("can", "fd", "udp")
PULLED_S, BACK_S = 3.0, 11.0
"""When a part is pulled out and plugged in again: half-way between two of its beats (every 2 s)."""


def told(done: CompletedProcess[str], *, beside: str = "") -> dict[str, list[Json]]:
    assert done.returncode == 0, done.stderr
    assert done.stderr == beside
    result: dict[str, list[Json]] = json.loads(done.stdout)
    return result


@pytest.fixture(scope="module", autouse=True)
def ends() -> Iterator[Ends]:
    """The ends of six demos, by what happens and link: three run at a time, and other tests meanwhile."""
    spare = ("--spare", "--seconds", "16", "--script", f"{PULLED_S}:unplug BB;{BACK_S}:plug BB;14:undo")
    unplugged = ("--seconds", "14", "--script", f"{PULLED_S}:unplug BB;{BACK_S}:plug BB")
    whole = ("--seconds", "8")
    demos = (("spare", spare, ("udp",)), ("unplugged", unplugged, ("can", "udp")), ("whole", whole, LINKS))
    with ThreadPoolExecutor(3) as threads:
        yield {
            (what, link): threads.submit(run, "demo", "--robot", "thesis", "--json", "--link", link, *options).result
            for what, options, links in demos
            for link in links
        }


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_without_a_terminal_it_prints_lines_and_ends_cleanly(number: signal.Signals, tmp_path: Path) -> None:
    with running("demo", "--robot", "thesis", "--link", "udp", cwd=tmp_path) as process:
        process.wait_for("AA", "active")
        process.wait_for("AA active life 3", "BB active life 3", "CC active life 3")
        assert process.end(number) == 0
    assert process.lines[-1] == "MSBOT_MASTER has ended."
    assert not [line for line in process.lines if "Traceback" in line]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--json"], "--seconds"),
        (["--script", "soon:unplug AA"], "3:unplug AA"),
        (["--script", "1:unplug DD", "--seconds", "1"], "AA, BB, CC"),
        (["--link", "carrier-pigeon"], "'can', 'fd', 'udp'"),
        (["--bitrate", "0"], "from 10000 to 1000000"),
    ],
)
def test_wrong_options_are_one_message_and_status_2(arguments: list[str], words: str) -> None:
    done = run("demo", "--robot", "thesis", *arguments)
    assert done.returncode == 2
    assert words in done.stderr
    assert "Traceback" not in done.stderr
    assert done.stdout == ""


@pytest.mark.parametrize("link", LINKS)
def test_three_parts_join_and_the_ring_runs(link: str, ends: Ends) -> None:
    result = told(ends["whole", link]())
    assert [part["name"] for part in result["parts"]] == ["AA", "BB", "CC"]
    for part in result["parts"]:
        assert part["state"] == "active"
        assert part["life"] == 3
        assert 0 < float(str(part["plug_in_to_active_ms"])) < 5_000  # bench/can.py measures it
        assert int(str(part["beats"])) >= 4
    assert len(result["topics"]) == 3
    for topic in result["topics"]:
        assert int(str(topic["published"])) >= 4
        assert int(str(topic["delivered"])) >= 0.95 * int(str(topic["published"]))
    if link == "udp":
        assert result["bus"] is None
    else:
        bus = result["bus"]
        assert isinstance(bus, dict)
        assert bus["bitrate"] == 500_000
        assert bus["frames"] > 100
        assert 0 < bus["load_percent"] < 30
        assert bus["errors"] == 0


@pytest.mark.parametrize("link", ["can", "udp"])
def test_an_unplugged_part_is_lost_when_its_beats_are_missing_and_comes_back(link: str, ends: Ends) -> None:
    """How long that takes is tested in virtual time: on a busy computer the last beat, and the look at it, are late."""
    result = told(ends["unplugged", link]())
    changes = [event for event in result["events"] if event["part"] == "BB"]
    (index,) = [index for index, event in enumerate(changes) if event["to"] == "lost"]
    lost, after = changes[index], changes[index + 1 :]
    assert float(str(lost["at_s"])) > PULLED_S
    silent = re.fullmatch(r"no beat for ([\d.]+) s: life status 0", str(lost["reason"]))
    assert silent is not None
    assert float(silent[1]) >= 4.0
    # First lost, then back: whether that was before BACK_S is up to how busy the computer is.
    assert any(event["to"] == "active" and float(str(event["at_s"])) > BACK_S for event in after)
    assert {event["part"] for event in result["events"] if event["to"] == "lost"} == {"BB"}
    assert [part["state"] for part in result["parts"]] == ["active"] * 3


def test_a_spare_takes_over_within_one_tick_and_undo_brings_the_first_part_back(ends: Ends) -> None:
    beside = "change 1 undone: the spare DD has taken over slot BB from EFGH-local\n"
    result = told(ends["spare", "udp"](), beside=beside)
    (lost,) = [
        float(str(event["at_s"])) for event in result["events"] if (event["part"], event["to"]) == ("BB", "lost")
    ]
    (over,) = [
        float(str(event["at_s"])) for event in result["events"] if (event["part"], event["to"]) == ("DD", "active")
    ]
    assert 0 <= over - lost <= 2.0
    assert {part["name"]: part["slot"] for part in result["parts"]} == {"AA": "AA", "BB": "BB", "CC": "CC", "DD": ""}
