"""A master and its parts as a person starts them, and a database server that can be frozen."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from functools import partial
from pathlib import Path

import httpx

from msbot.registry import open_registry
from msbot.registry.edits import users
from msbot.registry.records import database_identity
from msbot.stop.stop_request import ask_masters
from msbot_web.access.sessions import digest_of
from tests.e2e.processes import Process, run, running
from tests.e2e.test_processes import free_port

PATIENCE_S = 90.0
TOKEN = "msbot_a_token_of_the_tests"


class Robot:
    """A master and its parts as processes, in folders of their own.

    Its parts are delisted after minutes only: one that is frozen, or has no turn for seconds, is still there.
    """

    def __init__(self, folder: Path, stack: ExitStack, db: str | None = None) -> None:
        self.folder, self.stack, self.db = folder, stack, db
        self.page = ""
        self._browser = stack.enter_context(httpx.Client(timeout=PATIENCE_S, verify=False))  # it may sign its own
        self.link = f"udp:127.0.0.1:{free_port()}"
        (folder / "run").mkdir(mode=0o700)
        self.env = {"XDG_STATE_HOME": str(folder / "state"), "XDG_RUNTIME_DIR": str(folder / "run")}
        assert run("init", cwd=folder).returncode == 0
        sample = (folder / "robot.toml").read_text()
        assert "# life = 3 " in sample
        (folder / "robot.toml").write_text(sample.replace("# life = 3 ", "life = 100 "))

    def master(self, *more: str, page: bool = False, password_hash: str = "") -> Process:
        """Start a master, perhaps with more options; its page lets a teacher in who shows `TOKEN`, or a password."""
        options = (*more, *(() if self.db is None else ("--db", self.db)))
        pages: tuple[str, ...] = ("--no-page",)
        if page:
            teacher = users.Person("ann", "teacher", password_hash, tokens=(("test", digest_of(TOKEN)),))
            with open_registry(self.db or self.folder / "robot.db") as registry:
                registry.edits.make(None, "test", partial(users.keep, people=[teacher]))
            port = free_port()
            scheme = "https" if "--certificate" in more else "http"
            self.page, pages = f"{scheme}://127.0.0.1:{port}/api", ("--port", str(port))
        process = running("master", *pages, "--link", self.link, *options, cwd=self.folder, env=self.env)
        started = self.stack.enter_context(process)
        started.wait_for("is up on", self.link)
        if page:
            started.wait_for("The page is at")
        return started

    def call(self, how: str, path: str, content: object = None) -> tuple[int, dict[str, object]]:
        """Ask the page's API; gives status and answer."""
        bearer = {"authorization": f"Bearer {TOKEN}"}
        answer = self._browser.request(how, f"{self.page}{path}", json=content, headers=bearer)
        found = answer.json()
        assert isinstance(found, dict)
        return answer.status_code, found

    def open_page(self) -> httpx.Client:
        """A connection to the page's API that is open from now on, as that of a browser is."""
        bearer = {"authorization": f"Bearer {TOKEN}"}
        page = self.stack.enter_context(
            httpx.Client(base_url=self.page, headers=bearer, timeout=PATIENCE_S, verify=False)
        )
        assert page.get("/robot").status_code == httpx.codes.OK
        return page

    def part(self, name: str, stack: ExitStack | None = None) -> Process:
        """Start a part; it is killed when the robot's stack ends, or this one."""
        process = running("part", name, "--link", self.link, cwd=self.folder, env=self.env)
        return (stack or self.stack).enter_context(process)

    def parts(self, *names: str) -> dict[str, Process]:
        started = {name: self.part(name) for name in names}
        for one in started.values():
            one.wait_for("is active")
        return started

    def ask(self, *words: str) -> dict[str, object]:
        """A command with --json."""
        options = () if self.db is None else ("--db", self.db)
        done = run(*words, *options, "--json", cwd=self.folder, env=self.env)
        assert done.returncode == 0, done.stderr
        answer = json.loads(done.stdout)
        assert isinstance(answer, dict)
        return answer

    def tell(self, do: str) -> dict[str, object]:
        """The same without the time that a command takes to start; STOP waits for its confirmations."""
        database = database_identity(self.db or str(self.folder / "robot.db"))
        ((answer,), _) = ask_masters({"do": do, "who": "ann", "database": database}, PATIENCE_S)
        until(lambda: do != "stop" or not self.tell("status")["silent"])
        return answer | ({"silent": []} if do == "stop" else {})


def until(condition: Callable[[], bool]) -> None:
    """Wait for a condition, and not for ever."""
    end = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < end, "it does not come to that"
        time.sleep(0.05)


@contextmanager
def frozen(folder: Path) -> Iterator[None]:
    """A PostgreSQL server that does not answer any more: all of its processes stand still."""
    leader = int((folder / "data/postmaster.pid").read_text().split()[0])
    children = subprocess.run(["pgrep", "-P", str(leader)], capture_output=True, text=True, check=False).stdout
    everybody = [leader, *(int(pid) for pid in children.split())]
    for pid in everybody:
        os.kill(pid, signal.SIGSTOP)
    try:
        yield
    finally:
        for pid in everybody:
            os.kill(pid, signal.SIGCONT)
