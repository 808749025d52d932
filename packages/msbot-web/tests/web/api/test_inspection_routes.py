"""Topics and the log by the API: what there is, messages as they come, lines since a number, each for whom it is."""

from __future__ import annotations

import re
from collections.abc import Iterator

import pytest

from tests.e2e.processes import running
from tests.web.api.test_routes import Site

RING = "HelloWorldTopic_1_to_2"


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Site]:
    """A robot with one simulated part."""
    folder = tmp_path_factory.mktemp("inspected")
    with running("init", cwd=folder) as making:
        making.wait_for("robot.toml")
    with running("master", "--link", "udp:127.0.0.1:0", "--port", "0", cwd=folder) as process:
        address = re.search(r"udp:127\.0\.0\.1:\d+", process.wait_for("is up on"))
        assert address is not None
        site = Site(process, folder)
        with running("part", "ABCD", "--link", address[0], cwd=folder):
            process.wait_for("active in slot AA")
            yield site
            site.stranger.close()


def test_a_topic_says_what_it_is_and_who_is_at_it(site: Site) -> None:
    told = site.ask("GET", f"/api/topics/{RING}", role="viewer").json()
    assert (told["type"], told["fields"]) == ("HelloWorld", [["index", "uint32"], ["message", "text"]])
    assert told["types"] == {"HelloWorld": told["fields"]}
    assert told["publishers"] == [{"slot": "AA", "port": "out", "part": "ABCD"}]
    assert told["subscribers"] == [{"slot": "BB", "port": "in", "part": ""}]
    missing = site.ask("GET", "/api/topics/nothing", role="viewer")
    assert missing.status_code == 404
    assert RING in missing.json()["error"]


def test_messages_come_one_after_the_other(site: Site) -> None:
    path = f"/api/topics/{RING}/messages"
    last = site.ask("GET", path, role="viewer").json()
    assert (last["type"], last["samples"]) == ("HelloWorld", [])
    got: list[dict[str, object]] = []
    after = last["next"]
    while len(got) < 2:
        told = site.ask("GET", f"{path}?after={after}&wait=3", role="viewer").json()
        assert told["missed"] == 0
        assert told["next"] == after + len(told["samples"])
        got, after = got + told["samples"], told["next"]
    assert {one["slot"] for one in got} == {"AA"}
    indices = [one["fields"]["index"] for one in got]  # type: ignore[index]
    assert indices == list(range(indices[0], indices[0] + len(got)))
    assert site.ask("GET", f"{path}?after=x", role="viewer").status_code == 422
    assert site.ask("GET", f"{path}?type=Level", role="viewer").status_code == 400


def test_the_log_goes_on_where_the_last_answer_ended(site: Site) -> None:
    before = site.ask("GET", "/api/log?last=0").json()
    site.ask("POST", "/api/stop", json={"reason": "a finger"}, role="teacher")
    told = site.ask("GET", f"/api/log?after={before['next']}&wait=3", role="viewer").json()
    assert told["missed"] == 0
    assert any("a finger" in line["words"] and line["kind"] == "person" for line in told["lines"])
    site.ask("POST", "/api/go", json={"stop": site.ask("GET", "/api/robot").json()["stop"]["number"]})
    of_slot = site.ask("GET", "/api/log?last=200&slot=AA", role="viewer").json()["lines"]
    assert of_slot
    assert {line["slot"] for line in of_slot} == {"AA"}


def test_addresses_in_the_log_are_for_teachers(site: Site) -> None:
    def told(role: str) -> str:
        lines = site.ask("GET", "/api/log?last=200", role=role).json()["lines"]
        return "\n".join(f"{line['who']} {line['words']}" for line in lines)

    assert re.search(r"127\.0\.0\.1:\d+", told("teacher"))
    for role in ("viewer", "student"):
        assert "active in slot AA" in told(role)
        assert not re.search(r"127\.0\.0\.1:\d+", told(role))
