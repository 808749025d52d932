"""Every door of the page's server, tried by everybody: who may do what is the same whatever way somebody comes.

The robot is one for a class, with the groups Red and Blue. The oracle says what a person may do from the rights of the
role, the groups and who is held; the doors are asked. What comes in by a pupil's connection for parts, and what is
spoken inside, is tried in `test_pupils_escape.py`.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import httpx
import pytest
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect

from msbot.operations.rights import Right, Role
from tests.e2e.processes import running
from tests.web.api.test_routes import PASSWORD, Site


@dataclass(frozen=True)
class Door:
    """One way to see or do something."""

    method: str
    path: str
    right: Right | None
    """What it needs; None: nothing that anybody could have without an account."""
    json: object = None
    slot: str = ""
    """At which slot something is done."""
    holds: bool = False
    """Whether a pupil who is held cannot do it."""

    def __str__(self) -> str:
        return f"{self.method} {self.path}"


SEE, OPERATE, SET, ARRANGE = Right.SEE, Right.OPERATE, Right.SET, Right.ARRANGE
DOORS = (
    *(Door("GET", path, SEE) for path in (
        "/api/robot", "/api/parts", "/api/arrivals", "/api/why/nobody", "/api/topics", "/api/timeline", "/api/journal",
        "/api/bus", "/api/bus/frames", "/api/library", "/api/edits", "/api/blueprint", "/api/mission", "/api/me",
        "/api/slots/lamp_Red", "/api/slots/lamp_Red/values", "/metrics", "/api/log", "/api/topics/none",
        "/api/topics/none/messages", "/api/lesson/hand_ins",
    )),
    Door("GET", "/api/doctor", ARRANGE),
    Door("GET", "/api/tickets", ARRANGE),
    Door("POST", "/api/users/ada/tickets", Right.ADMINISTER, {"words": ""}),
    Door("POST", "/api/stop", Right.STOP),
    Door("POST", "/api/go", ARRANGE),
    Door("PUT", "/api/slots/lamp_Red/values/none", SET, {"value": 1}, "lamp_Red", holds=True),
    Door("PUT", "/api/slots/lamp_Blue/values/none", SET, {"value": 1}, "lamp_Blue", holds=True),
    Door("PUT", "/api/slots/LAMP_RED/values/none", SET, {"value": 1}, "lamp_Red", holds=True),
    Door("DELETE", "/api/slots/lamp_Red/values/none", SET, None, "lamp_Red", holds=True),
    Door("POST", "/api/ports/lamp_Red.none/publish", OPERATE, {"values": ["1"]}, "lamp_Red", holds=True),
    Door("POST", "/api/ports/lamp_Red.none/let_go", OPERATE, None, "lamp_Red", holds=True),
    Door("POST", "/api/ports/lamp_Red.none/call", OPERATE, {"values": ["1"]}, "lamp_Red", holds=True),
    Door("POST", "/api/ports/lamp_Blue.none/call", OPERATE, {"values": ["1"]}, "lamp_Blue", holds=True),
    Door("POST", "/api/topics/none/publish", OPERATE, {"values": ["1"]}, holds=True),
    Door("PUT", "/api/sim/lamp_Red/none", OPERATE, {"value": 1}, "lamp_Red", holds=True),
    Door("PUT", "/api/sim/lamp_Red/plugged", OPERATE, {"value": True}, "lamp_Red", holds=True),
    Door("POST", "/api/parts/lamp_Red/identify", OPERATE, None, "lamp_Red", holds=True),
    Door("POST", "/api/world/reset", OPERATE, holds=True),
    Door("POST", "/api/world/put", OPERATE, {"robot": "x", "x": 1, "y": 1}, holds=True),
    Door("POST", "/api/lesson/hand", OPERATE, {"down": True}),
    Door("POST", "/api/parts/none/adopt", ARRANGE, {}),
    Door("POST", "/api/slots/lamp_Red/swap", ARRANGE, {"to": "none"}),
    Door("POST", "/api/parts/none/block", ARRANGE, {}),
    Door("POST", "/api/faults/clear", ARRANGE, {}),
    Door("POST", "/api/mission/stop", ARRANGE),
    Door("PUT", "/api/class/groups/Red", ARRANGE, {"pupils": ["red"], "slots": ["lamp_Red"]}),
    Door("POST", "/api/class/pupils/nobody/take_over", ARRANGE, {}),
    Door("POST", "/api/slots/lamp_Red/simulate", ARRANGE, {"end": True}),
    Door("POST", "/api/lesson/hand_ins/1/return", ARRANGE, {"comment": ""}),
    Door("POST", "/api/slots/lamp_Red/spare", Right.DESIGN, {"part": "none"}),
    Door("POST", "/api/gallery", Right.DESIGN, {"robot": "none"}),
    Door("POST", "/api/lesson/start", Right.DESIGN, {"lesson": "none"}),
    Door("POST", "/api/blueprint/diff", Right.DESIGN, {"toml": "x"}),
    Door("PUT", "/api/blueprint", Right.DESIGN, {"toml": "x"}),
    Door("POST", "/api/topics/x/unbind", Right.DESIGN, {}),
    Door("GET", "/api/users", Right.ADMINISTER),
    Door("GET", "/api/card", Right.ADMINISTER),
    Door("PATCH", "/api/card", Right.ADMINISTER, {"name": "none"}),
    Door("POST", "/api/card/back", Right.ADMINISTER),
    Door("POST", "/api/card/restart", Right.ADMINISTER),
    Door("POST", "/api/users", Right.ADMINISTER, {"name": "", "role": "administrator", "password": PASSWORD}),
    Door("PATCH", "/api/users/nobody", Right.ADMINISTER, {"role": "administrator"}),
    Door("POST", "/api/users/ada/tokens", Right.ADMINISTER, {"words": ""}),
    Door("POST", "/api/restore", Right.ADMINISTER),
)  # fmt: skip
ROLES = {"vic": Role.VIEWER, "red": Role.STUDENT, "blue": Role.STUDENT, "tea": Role.TEACHER, "ada": Role.ADMINISTRATOR}
"""Who is there; `removed`, `nobody` and `relay`, which shows the ticket of one, have no right here."""
OTHERS = frozenset(
    ("/api/robot", "/api/stop", "/api/go", "/api/lesson/hand", "/api/parts/none/adopt", "/api/blueprint/diff")
) | {"/api/users"}
"""Doors that are the same for people who are held."""
HOLDS = ("is frozen by", "belongs to group", "has taken over")


def may(who: str, door: Door, state: str) -> bool:
    """The oracle."""
    role = ROLES.get(who)
    if role is None or door.right is None or role < door.right.least:
        return False
    if role >= Right.ARRANGE.least:
        return True
    if door.slot and not door.slot.lower().endswith(who):
        return False
    return not (door.holds and (state == "frozen" or (state == "red is taken over" and who == "red")))


def is_let_in(answer: httpx.Response) -> bool:
    """Whether somebody was let do it; that it could not be done is another matter."""
    return answer.status_code not in (401, 403) and not any(words in answer.text for words in HOLDS)


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Site]:
    folder: Path = tmp_path_factory.mktemp("class")
    with running("pupils", "robot", "--groups", "Red,Blue", "class.toml", cwd=folder) as making:
        making.wait_for("class.toml")
    with running("master", "class.toml", "--link", "udp:127.0.0.1:0", "--port", "0", cwd=folder) as process:
        site = Site(process, folder)
        site.tokens["ada"] = site.tokens["administrator"]
        for who, role in {**ROLES, "removed": Role.TEACHER}.items():
            if who != "ada":
                one = {"name": who, "role": role.word, "password": PASSWORD}
                assert site.ask("POST", "/api/users", json=one).status_code == 200
                site.tokens[who] = site._token(who)
        assert site.ask("DELETE", "/api/users/removed").status_code == 200
        site.tokens["nobody"] = "msbot_of_nobody"
        made = site.ask("POST", "/api/users/tea/tickets", json={"words": "body"})
        site.tokens["relay"] = str(made.json()["token"])
        for group in ("Red", "Blue"):
            slots = [f"{one}_{group}" for one in ("lamp", "eyes", "wheels", "bumper", "program")]
            given = {"pupils": [group.lower()], "slots": slots}
            assert site.ask("PUT", f"/api/class/groups/{group}", json=given).status_code == 200
        yield site
        site.stranger.close()


@pytest.mark.parametrize("state", ["nobody is held", "frozen", "red is taken over"])
def test_a_door_lets_in_who_may_and_nobody_else(site: Site, state: str) -> None:
    if state == "frozen":
        assert site.ask("POST", "/api/class/freeze", json={}).status_code == 200
    elif state == "red is taken over":
        assert site.ask("POST", "/api/class/pupils/red/take_over", json={}).status_code == 200
    wrong = []
    doors, people = list(DOORS), [*ROLES, "removed", "nobody", "relay"]
    if state != "nobody is held":  # the doors that it concerns, and one of each other right
        doors = [door for door in DOORS if door.holds or door.path in OTHERS]
        people = ["vic", "red", "blue", "tea"]
    for door in doors:
        for who in people:
            answer = site.ask(door.method, door.path, role=who, json=door.json)
            if is_let_in(answer) != may(who, door, state):
                wrong.append((str(door), who, answer.status_code, answer.text[:100]))
    site.ask("POST", "/api/class/thaw")
    site.ask("POST", "/api/class/pupils/red/hand_back")
    assert wrong == []


def test_a_browser_may_what_its_person_may_and_nothing_once_it_has_signed_out(site: Site) -> None:
    wrong = []
    for who in ("vic", "red", "tea"):
        with site.browser(who) as browser:
            for door in DOORS:
                answer = browser.request(door.method, door.path, json=door.json)
                if is_let_in(answer) != may(who, door, ""):
                    wrong.append((str(door), who, answer.status_code, answer.text[:100]))
            kept = dict(browser.cookies)
            browser.post("/logout")
            browser.cookies.update(kept)
            for door in DOORS[::8]:
                if is_let_in(browser.request(door.method, door.path, json=door.json)):
                    wrong.append((str(door), f"{who}, signed out", 0, ""))
    assert wrong == []


@pytest.mark.parametrize("path", ["/api/link", "/_nicegui_ws/socket.io/?EIO=4&transport=websocket"])
@pytest.mark.parametrize("who", ["removed", "nobody"])
def test_no_websocket_opens_for_nobody(site: Site, path: str, who: str) -> None:
    headers = {"authorization": f"Bearer {site.tokens[who]}"}
    with (
        contextlib.suppress(InvalidStatus),
        connect(site.base.replace("http", "ws") + path, additional_headers=headers, open_timeout=10),
    ):
        pytest.fail("it was opened")
