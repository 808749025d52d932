"""The API of a running master, over real HTTP: set-up, roles, attempted attacks, and a fuzzer on its own OpenAPI."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import httpx
import pytest
import schemathesis
from hypothesis import HealthCheck, given, settings
from schemathesis import GenerationMode
from schemathesis.core.result import Ok
from schemathesis.schemas import APIOperation

from tests.e2e.processes import Process, running

PASSWORD = "correct horse"
ROLES = ("viewer", "student", "teacher", "administrator")


class Site:
    """A master with its page, set up by an administrator called ada."""

    def __init__(self, process: Process, folder: Path) -> None:
        self.folder = folder
        line = process.wait_for("The page is at")
        found = re.search(r"(https?://[^/]+)/setup\?token=(\S+)", line)
        assert found is not None, line
        self.base, self.setup_token = found[1], found[2]
        self.stranger = httpx.Client(base_url=self.base, timeout=30)
        """Who has not signed in. One for all calls: making a client costs more than a call."""
        with httpx.Client(base_url=self.base, timeout=30) as visitor:
            form = {"token": self.setup_token, "name": "ada", "password": PASSWORD, "again": PASSWORD}
            assert visitor.post("/setup", data=form).status_code == 303
        self.tokens = {"administrator": self._token("ada")}
        for role in ROLES[:-1]:
            name = f"{role}-person"
            done = self.ask("POST", "/api/users", json={"name": name, "role": role, "password": PASSWORD})
            assert done.status_code == 200, done.text
            self.tokens[role] = self._token(name)

    def _token(self, name: str) -> str:
        with self.browser(name) as visitor:
            answer = visitor.post(f"/api/users/{name}/tokens", json={"words": "tests"})
            assert answer.status_code == 200, answer.text
            return str(answer.json()["token"])

    @contextmanager
    def browser(self, name: str) -> Iterator[httpx.Client]:
        """A client that has signed in by the form, and shows the CSRF word."""
        with httpx.Client(base_url=self.base, timeout=30) as client:
            assert client.post("/login", data={"name": name, "password": PASSWORD}).status_code == 303
            client.headers["x-csrf-token"] = client.get("/api/me").json()["csrf"]
            yield client

    def ask(self, method: str, path: str, *, role: str = "administrator", json: object = None) -> httpx.Response:
        """A call with an API token."""
        headers = {"authorization": f"Bearer {self.tokens[role]}"}
        return self.stranger.request(method, path, headers=headers, json=json)


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Site]:
    folder = tmp_path_factory.mktemp("site")
    with running("init", cwd=folder) as making:
        making.wait_for("robot.toml")
    with running("master", "--link", "udp:127.0.0.1:0", "--port", "0", cwd=folder) as process:
        site = Site(process, folder)
        yield site
        site.stranger.close()


def test_the_set_up_link_is_of_no_use_afterwards(site: Site) -> None:
    form = {"token": site.setup_token, "name": "eve", "password": PASSWORD, "again": PASSWORD}
    assert site.stranger.post("/setup", data=form).status_code == 403


def test_only_the_health_check_and_the_schema_answer_strangers(site: Site) -> None:
    assert site.stranger.get("/api/health").json() == {"status": "ok"}
    schema = site.stranger.get("/openapi.json").json()
    for path, calls in schema["paths"].items():
        for method in calls:
            answer = site.stranger.request(method, path.replace("{", "x").replace("}", ""))
            assert answer.status_code == (200 if path == "/api/health" else 401), (method, path)


def test_a_program_reads_the_figures_for_prometheus_and_a_stranger_does_not(site: Site) -> None:
    pytest.importorskip("prometheus_client", reason="pip install 'msbot[metrics]'")
    answer = site.ask("GET", "/metrics", role="viewer")
    assert answer.status_code == 200
    assert answer.headers["content-type"].startswith("text/plain")
    assert "msbot_slots 3.0" in answer.text
    assert "msbot_database_well 1.0" in answer.text
    for headers in ({}, {"authorization": "Bearer msbot_wrong"}):
        refused = site.stranger.get("/metrics", headers=headers)
        assert refused.status_code == 401
        assert "on the page Admin, API tokens" in refused.json()["error"]
        assert refused.headers["www-authenticate"] == "Bearer"


CALLS = [
    ("GET", "/api/robot", None, "viewer"),
    ("POST", "/api/stop", {"reason": "test"}, "viewer"),
    ("POST", "/api/go", None, "teacher"),
    ("GET", "/api/lesson/hand_ins", None, "viewer"),
    ("GET", "/api/lesson/hand_ins/1", None, "viewer"),
    ("POST", "/api/lesson/hand_ins", {"note": "x"}, "student"),
    ("POST", "/api/lesson/hand_ins/1/return", {"comment": "x"}, "teacher"),
    ("PUT", "/api/slots/AA/values/x", {"value": 1}, "student"),
    ("POST", "/api/parts/nobody/identify", None, "student"),
    ("POST", "/api/parts/nobody/adopt", {"slot": "AA"}, "teacher"),
    ("POST", "/api/parts/nobody/ignore", None, "teacher"),
    ("POST", "/api/parts/nobody/block", {"reason": "x"}, "teacher"),
    ("POST", "/api/parts/nobody/unblock", None, "teacher"),
    ("POST", "/api/slots/AA/swap", {"to": "nobody"}, "teacher"),
    ("POST", "/api/slots/AA/release", None, "teacher"),
    ("DELETE", "/api/slots/AA/values/x", None, "student"),
    ("POST", "/api/topics/x/bind", {"type": "HelloWorld", "to": ["AA.x"]}, "teacher"),
    ("POST", "/api/topics/x/unbind", None, "teacher"),
    ("POST", "/api/window", {"seconds": 5}, "teacher"),
    ("DELETE", "/api/window", None, "teacher"),
    ("PUT", "/api/blueprint", {"toml": "x"}, "teacher"),
    ("GET", "/api/users", None, "administrator"),
    ("POST", "/api/users", {"name": "x", "role": "viewer", "password": "short"}, "administrator"),
    ("PATCH", "/api/users/ada", {"role": "viewer"}, "administrator"),
    ("DELETE", "/api/users/ada", None, "administrator"),
    ("POST", "/api/users/ada/tokens", {"words": ""}, "administrator"),
    ("DELETE", "/api/users/ada/tokens/nothing", None, "administrator"),
    ("GET", "/api/backup", None, "administrator"),
    ("POST", "/api/restore", {"no": "backup"}, "administrator"),
]  # fmt: skip


@pytest.mark.parametrize(("method", "path", "body", "least"), CALLS)
def test_each_call_is_refused_to_every_lower_role(site: Site, method: str, path: str, body: object, least: str) -> None:
    for role in ROLES:
        answer = site.ask(method, path, role=role, json=body)
        if ROLES.index(role) < ROLES.index(least):
            assert answer.status_code == 403, (role, answer.text)
            assert f"a {role} may not" in answer.json()["error"]
        else:
            assert answer.status_code not in (401, 403), (role, answer.text)
            assert answer.status_code < 500


def test_everybody_changes_the_own_password_and_nobody_elses(site: Site) -> None:
    done = site.ask("POST", "/api/users", json={"name": "pat", "role": "student", "password": PASSWORD})
    assert done.status_code == 200
    path = "/api/users/pat"
    for role in ROLES:  # nobody does it with an API token
        assert site.ask("PATCH", path, role=role, json={"password": PASSWORD}).status_code == 403
    with site.browser("teacher-person") as visitor:
        assert visitor.patch(path, json={"password": PASSWORD}).status_code == 403
    with site.browser("pat") as visitor:
        token = visitor.post(f"{path}/tokens", json={"words": "tests"}).json()["token"]
        assert visitor.patch(path, json={"role": "administrator"}).status_code == 403
        refused = visitor.patch(path, json={"password": "another horse", "old_password": "guess"})
        assert (refused.status_code, refused.json()) == (400, {"error": "the old password is wrong"})
        body = {"password": "another horse", "old_password": PASSWORD}
        assert visitor.patch(path, json=body).status_code == 200
        assert visitor.get("/api/me").status_code == 401, "a new password ends the sessions"
    bearer = {"authorization": f"Bearer {token}"}
    assert site.stranger.get("/api/me", headers=bearer).status_code == 401, "and the tokens"


def test_only_who_may_change_a_blueprint_may_compare_one_and_not_a_large_one(site: Site) -> None:
    for role, status in (("viewer", 403), ("student", 403), ("teacher", 400)):
        assert site.ask("POST", "/api/blueprint/diff", role=role, json={"toml": "x"}).status_code == status
    large = site.ask("POST", "/api/blueprint/diff", role="teacher", json={"toml": "x" * 300_000})
    assert large.status_code == 422


def test_a_browser_asks_whether_its_files_are_still_those_of_this_version(site: Site) -> None:
    with site.browser("ada") as visitor:
        for path in ("/web/page.js", "/web/msbot.css", "/web/blockly/de.js"):
            answer = visitor.get(path)
            assert (answer.status_code, answer.headers["cache-control"]) == (200, "no-cache")
            again = visitor.get(path, headers={"if-none-match": answer.headers["etag"]})
            assert (again.status_code, again.headers["cache-control"], again.content) == (304, "no-cache", b"")


def test_an_address_that_there_is_not_builds_no_page(site: Site) -> None:
    with site.browser("ada") as visitor:
        for path in ("/nothing", "/_nicegui/nothing", "/web/nothing"):
            answer = visitor.get(path)
            assert answer.status_code == 404
            assert len(answer.content) < 100


def test_a_cookie_alone_changes_nothing(site: Site) -> None:
    with site.browser("ada") as visitor:
        del visitor.headers["x-csrf-token"]
        assert visitor.post("/api/stop", json={}).status_code == 403
        assert visitor.get("/api/robot").status_code == 200
        evil = {"origin": "http://evil.example"}
        assert visitor.post("/api/stop", json={}, headers=evil).status_code == 403


def test_a_press_of_stop_that_is_said_again_is_no_second_stop(site: Site) -> None:
    with site.browser("ada") as visitor:

        def stop(press: str) -> bool:
            """Whether STOP holds afterwards; the answer says so, too."""
            status = visitor.post("/api/stop", json={}, headers={"x-stop-press": press}).status_code
            holds = bool(visitor.get("/api/robot").json()["stop"]["stopped"])
            assert status == (200 if holds else 409)
            return holds

        assert stop("first")
        assert stop("first")
        assert visitor.post("/api/go", json={}).status_code == 200
        assert not stop("first"), "its answer was late; a teacher has said GO meanwhile"
        for press in ("second", "x" * 65, "x" * 65):  # no name makes a STOP refused, and one that is too long is none
            assert stop(press)
            assert visitor.post("/api/go", json={}).status_code == 200


def test_markup_in_names_is_only_text(site: Site) -> None:
    name = "<img src=x onerror=alert(1)>"
    made = site.ask("POST", "/api/users", json={"name": name, "role": "viewer", "password": PASSWORD})
    assert made.status_code == 200
    with site.browser("ada") as visitor:
        page = visitor.get("/admin").text
        assert "<img src=x" not in page
        assert site.ask("DELETE", f"/api/users/{name}").status_code == 200


@pytest.mark.parametrize(
    "path",
    [
        "/web/../server.py",
        "/web/%2e%2e/server.py",
        "/web/..%2fserver.py",
        "/library/..%2f..%2fetc%2fpasswd",
        "/_nicegui/../../../etc/passwd",
        "/web//etc/passwd",
        "/api/backup/../../robot.toml",
    ],
)
def test_paths_lead_nowhere_else(site: Site, path: str) -> None:
    with site.browser("ada") as visitor:
        answer = visitor.get(path)
        assert "root:" not in answer.text
        assert "uvicorn" not in answer.text
        assert "[robot]" not in answer.text


@pytest.mark.promise("Bad input is refused with one sentence, and nothing dies of it")
@pytest.mark.parametrize(
    "body",
    [
        b'{"value": "\\ud800"}',
        b'{"value": "x\\udfffy"}',
        b'{"value": {"\\ud800": 1}}',
        b'{"\\ud800": 1}',
        b"[" * 100_000,
        b'{"value": ' + b"9" * 100_000 + b"}",
        b"{",
        b"\xff\xfe",
        b'{"value": NaN}',
    ],
)
def test_what_cannot_be_read_or_written_is_refused_with_a_sentence(site: Site, body: bytes) -> None:
    for path in ("/api/sim/AA/press", "/api/slots/AA/values/x", "/api/slots/BB/values/x"):
        headers = {"authorization": f"Bearer {site.tokens['teacher']}", "content-type": "application/json"}
        answer = site.stranger.request("PUT", path, content=body, headers=headers)
        assert answer.status_code in (400, 404, 422), answer.text
        assert set(answer.json()) == {"error"}


def test_an_oversized_body_is_refused(site: Site) -> None:
    answer = site.ask("PUT", "/api/blueprint", json={"toml": "x" * 2_000_000})
    assert answer.status_code == 413


def test_the_blueprint_is_compared_applied_and_undone(site: Site) -> None:
    text = site.ask("GET", "/api/blueprint").text
    assert site.ask("POST", "/api/blueprint/diff", json={"toml": text}).json() == {"changes": []}
    changed = text.replace("Light sensor, 5V", "Sees the sun")
    assert changed != text
    changes = site.ask("POST", "/api/blueprint/diff", json={"toml": changed}).json()["changes"]
    assert any("Sees the sun" in change for change in changes)
    wrong = site.ask("PUT", "/api/blueprint", json={"toml": text + "\n[[slot]]\nname = 1\n"})
    assert wrong.status_code == 400
    assert "line" in wrong.json()["error"]
    assert site.ask("PUT", "/api/blueprint", json={"toml": changed}).status_code == 200
    assert "Sees the sun" in site.ask("GET", "/api/blueprint").text
    assert site.ask("POST", "/api/undo", json={}).status_code == 200
    assert "Sees the sun" not in site.ask("GET", "/api/blueprint").text


def test_a_backup_comes_back_and_junk_does_not(site: Site) -> None:
    backup = site.ask("GET", "/api/backup").content
    assert backup.startswith(b"SQLite format 3")
    headers = {"authorization": f"Bearer {site.tokens['administrator']}"}
    junk = site.stranger.post("/api/restore", content=b"junk" * 100, headers=headers)
    assert junk.status_code == 409
    assert not (site.folder / "robot.db.restore").exists()
    kept = site.stranger.post("/api/restore", content=backup, headers=headers)
    assert kept.status_code == 200, kept.text
    assert (site.folder / "robot.db.restore").read_bytes() == backup


def test_every_change_names_who_made_it(site: Site) -> None:
    site.ask("POST", "/api/window", role="teacher", json={"seconds": 1})
    site.ask("POST", "/api/parts/WXYZ/block", role="teacher", json={"reason": "smokes"})
    newest = site.ask("GET", "/api/edits").json()[0]
    assert (newest["who"], newest["kind"]) == ("teacher-person", "block")
    assert site.ask("POST", "/api/parts/WXYZ/unblock", role="teacher").status_code == 200


def _operations(site: Site) -> Iterator[APIOperation[Any, Any, Any, Any]]:
    for result in schemathesis.openapi.from_url(f"{site.base}/openapi.json").get_all_operations():
        assert isinstance(result, Ok)
        yield result.ok()


@pytest.mark.parametrize("mode", [GenerationMode.POSITIVE, GenerationMode.NEGATIVE])
def test_the_api_never_fails_whatever_it_is_asked(site: Site, mode: GenerationMode) -> None:
    headers = {"authorization": f"Bearer {site.tokens['teacher']}"}
    asked = 0
    for operation in _operations(site):
        if mode is GenerationMode.NEGATIVE and not (operation.body or operation.query):
            continue  # the only wrong name in a path is one that is too long; generators need seconds to find it

        @settings(
            max_examples=2,  # the simplest one and another; `fuzz/targets/page.py` asks for more, without a socket
            suppress_health_check=list(HealthCheck),
            database=None,
        )
        @given(case=operation.as_strategy(generation_mode=mode))
        def ask(case: schemathesis.Case[Any]) -> None:
            nonlocal asked
            asked += 1
            answer = case.call(base_url=site.base, headers=headers)
            assert answer.status_code < 500, (case.method, case.path, answer.text)

        ask()
    assert asked > 40


def test_a_name_in_a_path_may_be_strange_but_not_too_long(site: Site) -> None:
    asked = 0
    for operation in _operations(site):
        for parameter in operation.path_parameters:
            for name, allowed in (("x" * 2000, range(422, 423)), ("%00%ff%F0%9F%A4%96", range(500))):
                path = re.sub(r"{\w+}", "AA", operation.path.replace(f"{{{parameter.name}}}", name))
                answer = site.ask(operation.method.upper(), path, role="teacher", json={})
                assert answer.status_code in allowed, (operation.method, path[:80], answer.text)
                asked += 1
    assert asked > 40


def test_programs_are_kept_by_person_and_version(site: Site) -> None:
    for text in ("print(1)\n", "print(2)\n", "print(2)\n"):
        done = site.ask("PUT", "/api/programs/mine.py", role="student", json={"text": text})
        assert done.status_code == 200, done.text
    assert done.json()["words"] == "mine.py is saved, version 2."
    assert [one["name"] for one in site.ask("GET", "/api/programs", role="student").json()] == ["mine.py"]
    assert site.ask("GET", "/api/programs", role="teacher").json() == []
    for query, text in (("", "print(2)\n"), ("?version=1", "print(1)\n")):
        kept = site.ask("GET", f"/api/programs/mine.py{query}", role="student").json()
        assert kept == {"text": text, "blocks": ""}
    versions = site.ask("GET", "/api/programs/mine.py/versions", role="student").json()
    assert [(one["number"], one["size"]) for one in versions] == [(2, 9), (1, 9)]
    assert "from msbot import" in site.ask("GET", "/api/programs/01_hello.py", role="student").json()["text"]
    assert site.ask("POST", "/api/programs/mine.py/share", role="student").json()["path"].startswith("/program?shared=")
    assert site.ask("GET", "/api/programs/mine.py", role="viewer").status_code == 403
    assert site.ask("PUT", "/api/programs/a%20b.py", role="student", json={"text": ""}).status_code == 400
    assert site.ask("PUT", "/api/programs/b.py", role="student", json={"text": "x" * 70_000}).status_code == 422
    made = {"text": "print(3)\n", "blocks": '{"msbot": 1}'}
    assert site.ask("PUT", "/api/programs/mine.py", role="student", json=made).status_code == 200
    assert site.ask("GET", "/api/programs/mine.py", role="student").json() == made
    made["blocks"] = "[]"
    assert site.ask("PUT", "/api/programs/mine.py", role="student", json=made).status_code == 400
    assert site.ask("DELETE", "/api/programs/mine.py", role="student").status_code == 200
    assert site.ask("GET", "/api/programs/mine.py", role="student").status_code == 404


def test_the_doctor_answers_teachers(site: Site) -> None:
    assert site.ask("GET", "/api/doctor", role="student").status_code == 403
    answer = site.ask("GET", "/api/doctor", role="teacher")
    assert answer.status_code == 200, answer.text
    found = answer.json()
    named = {line["check"] for name in ("findings", "not_looked_at", "not_needed") for line in found[name]}
    assert named | set(found["in_order"]) >= {"python", "database", "disk", "robot", "clock"}
    assert all(line["mend"] and line["saw"] for line in found["findings"])


def test_missions_say_what_they_need(site: Site) -> None:
    for act in ("stop", "go"):  # a made-up request may have said STOP, and may not
        assert site.ask("POST", f"/api/{act}", role="teacher").status_code == 200
    assert site.ask("GET", "/api/mission", role="viewer").json()["mission"] == ""
    for method, path, body, words in (
        ("POST", "/api/mission/start", {"mission": "one-silent"}, "needs a robot with the slots knob, fan"),
        ("POST", "/api/mission/start", {"mission": "a.toml", "toml": "x"}, "a.toml, line 1"),
        ("POST", "/api/mission/answer", {"kind": "loss"}, "no mission runs"),
        ("POST", "/api/mission/hint", None, "no mission runs"),
        ("GET", "/api/mission/report", None, "there is no report of a mission"),
    ):
        answer = site.ask(method, path, json=body)
        assert answer.status_code == 400, (path, answer.text)
        assert words in answer.json()["error"]
    assert site.ask("POST", "/api/mission/start", role="student", json={"mission": "echo"}).status_code == 403
