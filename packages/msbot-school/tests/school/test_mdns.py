"""Masters found in the network: those that are told to say that they are there, and nobody's word decides anything."""

from __future__ import annotations

import json
import os
import signal
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from msbot.config import SAMPLE_ROBOT_TOML, load_library, parse_blueprint
from msbot.registry import open_registry
from msbot.stop.socket_names import GROUP_VARIABLE
from msbot_school.classroom.mdns import LONGEST, check_class_name, parse_announcement
from msbot_xrce.errors import ConfigError
from tests.e2e.prepared import NETWORK
from tests.e2e.processes import Process, run
from tests.networks import BODY, Network, lonely_computer, two_computers

pytest.importorskip("zeroconf", reason="pip install 'msbot[announce]'")

TEXTS = {b"robot": b"ROVER", b"serial": b"7", b"version": b"1", b"class": b"7B", b"tls": b"0"}


def test_what_is_heard_is_told() -> None:
    (one,) = parse_announcement(TEXTS, 8080, ["fe80::1", "127.0.0.1", "10.0.0.2"])
    assert (one.robot, one.serial_number, one.class_name, one.address) == ("ROVER", "7", "7B", "http://10.0.0.2:8080")
    (sealed,) = parse_announcement({**TEXTS, b"tls": b"1"}, 443, ["10.0.0.2"])
    assert sealed.address == "https://10.0.0.2:443"


@pytest.mark.parametrize(
    ("texts", "port", "addresses"),
    [
        ({}, 8080, ["10.0.0.2"]),
        (TEXTS, 0, ["10.0.0.2"]),
        (TEXTS, None, ["10.0.0.2"]),
        (TEXTS, 8080, []),
        (TEXTS, 8080, ["127.0.0.1", "0.0.0.0", "224.0.0.1", "nonsense"]),
    ],
)
def test_what_leads_nowhere_is_left_out(
    texts: dict[bytes, bytes | None], port: int | None, addresses: list[str]
) -> None:
    assert list(parse_announcement(texts, port, addresses)) == []


@given(st.dictionaries(st.sampled_from(sorted(TEXTS)), st.none() | st.binary(max_size=300)))
def test_anything_may_be_said_and_what_is_shown_is_short_and_printable(texts: dict[bytes, bytes | None]) -> None:
    for one in parse_announcement(texts, 8080, ["10.0.0.2"]):
        for shown in (one.robot, one.serial_number, one.version, one.class_name):
            assert shown.isprintable()
            assert len(shown) <= LONGEST


@pytest.mark.parametrize("name", ["", "  ", "x" * 65, "a\nb"])
def test_a_class_has_a_name(name: str) -> None:
    with pytest.raises(ConfigError, match="the name of a class"):
        check_class_name(name)


@pytest.fixture
def network() -> Iterator[Network]:
    with two_computers() as made:
        yield made


def test_one_that_is_told_to_is_found_and_stopped_only_with_an_access(network: Network, tmp_path: Path) -> None:
    desk = {NETWORK: network.desk, "XDG_STATE_HOME": str(tmp_path / "desk"), "XDG_RUNTIME_DIR": str(tmp_path)}
    group = os.environ[GROUP_VARIABLE]  # both computers have one file system: without a group, all tests' robots stop
    (tmp_path / "robot.toml").write_text(SAMPLE_ROBOT_TOML)
    library = load_library()
    with open_registry(str(tmp_path / "robot.db")) as registry:
        registry.robots.apply_blueprint(parse_blueprint(SAMPLE_ROBOT_TOML, library), library)
    assert run("user", "add", "lab", "--role", "viewer", "--generate", cwd=tmp_path).returncode == 0
    token = run("user", "token", "lab", "class", cwd=tmp_path).stdout.strip()
    with ExitStack() as stack:

        def master(name: str, *options: str) -> Process:
            link = f"sim:{Path(name).stem}{network.body}"
            process = network.run(
                network.body,
                "master",
                name,
                "--host",
                "0.0.0.0",
                "--link",
                link,
                *options,
                cwd=tmp_path,
                env={"XDG_STATE_HOME": str(tmp_path / "body"), "XDG_RUNTIME_DIR": str(tmp_path)},
            )
            stack.callback(process.end, signal.SIGKILL)
            return process

        (tmp_path / "shy.toml").write_text(SAMPLE_ROBOT_TOML)
        shy = master("shy.toml", "--port", "8081")  # nobody told it to
        master("robot.toml", "--port", "8080", "--announce", "7B").wait_for(f"announced in {BODY} for class 7B")
        shy.wait_for("The page is at")

        elsewhere = tmp_path / "elsewhere"
        elsewhere.mkdir()
        found = json.loads(run("class", "find", "--seconds", "6", "--json", cwd=elsewhere, env=desk).stdout)
        assert [(one["page"], one["class"], one["has_access"]) for one in found] == [
            (f"http://{BODY}:8080", "7B", False)
        ]
        assert "NOT delivered: " in run("class", "stop", cwd=elsewhere, env=desk | _alone(tmp_path)).stderr

        desk |= _alone(tmp_path)
        for _ in range(5):  # as people do, where a busy computer makes its API for the first time
            joined = run("class", "join", found[0]["page"], cwd=elsewhere, env=desk | {"MSBOT_TOKEN": token})
            if "no answer in time" not in joined.stderr:
                break
        assert joined.returncode == 0, joined.stderr
        stopped = run("class", "stop", "--stop-group", group, cwd=elsewhere, env=desk)
        assert (stopped.returncode, stopped.stderr) == (0, "")
        assert "STOP holds; no part is in the robot" in stopped.stdout
        network.cut()
        cut = run("class", "stop", "--stop-group", group, cwd=elsewhere, env=desk)
        assert cut.returncode == 2
        assert f"NOT told: http://{BODY}:8080: Network is unreachable" in cut.stdout
        assert "NOT stopped: MSBOT_MASTER" in cut.stderr
        network.heal()
        assert run("class", "stop", "--stop-group", group, cwd=elsewhere, env=desk).returncode == 0


def _alone(folder: Path) -> dict[str, str]:
    """Nobody's master runs on this computer."""
    place = folder / "alone"
    place.mkdir(exist_ok=True)
    return {"XDG_RUNTIME_DIR": str(place), GROUP_VARIABLE: f"{os.getpid()}alone"}


def test_a_computer_in_no_network_is_told(tmp_path: Path) -> None:
    with lonely_computer() as name:
        ended = run("class", "find", cwd=tmp_path, env={NETWORK: name, "XDG_STATE_HOME": str(tmp_path)})
    assert ended.returncode == 2
    assert ended.stderr == "msbot: this computer is in no network: nothing can be announced, and nobody found\n"


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--announce", "7B"), "--announce needs a page that other computers can reach: --host 0.0.0.0"),
        (("--announce", "7B", "--host", "0.0.0.0", "--no-page"), "--announce needs a page"),
        (("--announce", " ", "--host", "0.0.0.0"), "the name of a class"),
        (("--announce", "7B", "--host", "192.0.2.77"), "192.0.2.77 is none: --host 0.0.0.0"),
    ],
)
def test_mistakes_are_told_before_the_robot_runs(options: tuple[str, ...], words: str, tmp_path: Path) -> None:
    (tmp_path / "robot.toml").write_text(SAMPLE_ROBOT_TOML)
    ended = run("master", *options, cwd=tmp_path)
    assert ended.returncode == 2
    assert words in ended.stderr
    assert not (tmp_path / "robot.db").exists()
