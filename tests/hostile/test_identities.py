"""Whoever knows a part's UID, address or client key can pretend to be it: no door tells them to viewers and students,
neither by what it answers nor by whether it finds a part by them."""

from __future__ import annotations

import re
import time
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pytest

from msbot_agent.link.net import PART_PATH
from tests.e2e.processes import running
from tests.web.api.test_routes import Site
from tests.web.browser.conftest import free_port

PROMISE = "Client keys, addresses and UIDs of parts are shown to teachers only"
LESS = ("viewer", "student")
SPARE = "53504152452e2e2e"
NAMES = re.compile(r"\{(\w+)\}")


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Site]:
    folder: Path = tmp_path_factory.mktemp("robot")
    link = f"udp:127.0.0.1:{free_port()}"
    with running("init", cwd=folder) as making:
        making.wait_for("robot.toml")
    with running("master", "--link", link, "--port", "0", cwd=folder) as process:
        site = Site(process, folder)
        with ExitStack() as parts:
            for words in (("BB",), ("ABCD", "--name", "first")):
                parts.enter_context(running("part", *words, "--link", link, cwd=folder)).wait_for("is active")
            spare = ("ABCD", "--name", "spare", "--uid", "53504152452e2e2e")  # it comes when the slot is taken
            parts.enter_context(running("part", *spare, "--link", link, cwd=folder))
            while not (standing_by := [one for one in _arrivals(site) if one["state"] == "standby"]):
                time.sleep(0.05)
            # People's deeds, whose sentences name parts.
            (waiting,) = standing_by
            for path, given in (("block", {"reason": "x"}), ("unblock", {})):
                done = site.ask("POST", f"/api/parts/{waiting['uid']}/{path}", json=given)
                assert done.status_code == 200, done.text
            yield site
        site.stranger.close()


def _arrivals(site: Site) -> list[dict[str, Any]]:
    arrivals: list[dict[str, Any]] = site.ask("GET", "/api/arrivals").json()
    return arrivals


def identities(site: Site) -> dict[str, str]:
    """What tells parts apart, each with a word of the same form that is nobody's."""
    parts = site.ask("GET", "/api/parts", role="teacher").json()
    assert len([part for part in parts if part["uid"]]) >= 3
    found: dict[str, str] = {}
    for part in parts:
        uid, address, key = part["uid"], part["address"], part["client_key"]
        found |= {uid: "0102030405060708", uid.upper(): "0A0B0C0D0E0F0A0B", address: "udp:192.0.2.9:4444"}
        found |= {":".join(re.findall("..", uid)): "01:02:03:04:05:06:07:08", key: "01020304"}
    return {word: bogus for word, bogus in found.items() if word}


def plain(word: str) -> str:
    return re.sub("[^0-9a-z]", "", word.casefold())


@pytest.mark.promise(PROMISE)
def test_no_door_tells_who_a_part_is(site: Site) -> None:
    secrets = identities(site)
    schema = site.stranger.get("/openapi.json").json()
    wrong, tried = [], 0
    for path, calls in schema["paths"].items():
        if path == PART_PATH or "get" not in calls:
            continue
        if "{number}" in path:  # a number of a table, which no part has: what is none is refused as it is
            continue
        queries = [one["name"] for one in calls["get"].get("parameters", ()) if one["in"] == "query"]
        words = [("BB", "BB")] if "{" not in path and not queries else [("BB", "BB"), *secrets.items()]
        for role in LESS:
            for word, bogus in words:
                answers = []
                for one in (word, bogus):
                    asked = NAMES.sub(one, path)
                    given = {name: one for name in queries if name in ("part", "field", "search")}
                    bearer = {"authorization": f"Bearer {site.tokens[role]}"}
                    answers.append(site.stranger.get(asked, params=given, headers=bearer))
                tried += 1
                told = answers[0].text.replace(word, "")
                if [secret for secret in secrets if secret in told or plain(secret) in re.split("[^0-9a-z]", told)]:
                    wrong.append((role, path, word, "tells"))
                texts = [one.text.replace(word, "?").replace(bogus, "?") for one in answers]
                if word != bogus and (texts[0] != texts[1] or answers[0].status_code != answers[1].status_code):
                    wrong.append((role, path, word, "finds"))
    assert wrong == []
    assert tried > 100
    lines = site.ask("GET", f"/api/journal?part={next(iter(secrets))}", role="teacher").json()
    assert lines, "a teacher finds them"


DOORS: tuple[tuple[str, str, dict[str, object] | None], ...] = (
    ("POST", "/api/parts/{}/identify", {}), ("PUT", "/api/slots/{}/values/x", {"value": 1}),
    ("POST", "/api/ports/{}.in/publish", {"values": ["1", "x"]}), ("POST", "/api/ports/{}.in/let_go", {}),
    ("DELETE", "/api/slots/{}/values/x", None), ("PUT", "/api/sim/{}/press", {"value": True}),
    ("POST", "/api/mission/answer", {"kind": "unplug", "at": "{}"}),
    ("POST", "/api/mission/repair", {"repair": "plug-in", "at": "{}"}),
    ("POST", "/api/parts/{}/adopt", {}), ("POST", "/api/parts/{}/block", {}),
    ("POST", "/api/slots/BB/swap", {"to": "{}"}),
)  # fmt: skip


@pytest.mark.promise(PROMISE)
def test_no_deed_finds_a_part_by_them(site: Site) -> None:
    wrong = []
    for method, path, given in DOORS:
        for role in LESS:
            for word, bogus in identities(site).items():
                answers = []
                for one in (word, bogus):
                    body = given and {
                        name: value.replace("{}", one) if isinstance(value, str) else value
                        for name, value in given.items()
                    }
                    # The test may be quicker than a person may: what comes too soon is asked again.
                    while (
                        answer := site.ask(method, path.replace("{}", one), role=role, json=body)
                    ).status_code == 429:
                        continue
                    answers.append((answer.status_code, answer.text.replace(one, "?")))
                if answers[0] != answers[1]:
                    wrong.append((role, method, path, word, answers))
    assert wrong == []
