"""The robot on a card's image that runs in a virtual computer: its page, its API, and when it comes."""

from __future__ import annotations

import re
import sys
import threading
import time
from collections.abc import Callable

import httpx

from tools.card_image.base import ImageError
from tools.card_image.machine import Machine

PATIENCE_S = 1800.0
"""How long a start may take: software emulation, maybe on a busy computer."""
STAGES = {
    "Linux": r"Booting Linux|Linux version",
    "the root is there": r"systemd\[1\]: systemd \S+ running|Welcome to",
    "the card's settings": r"Finished .*Settings of the MsBOT card",
    "network": r"Reached target (network\.target - )?Network\.",
    "the master starts": r"Started .*MsBOT robot: master",
}
"""What the console says, in the order of a start."""
NAME, PASSWORD = "ada", "correct horse"


class Robot:
    """The robot on the card, by its page.

    Args:
        machine: where it runs.
    """

    def __init__(self, machine: Machine) -> None:
        self.machine = machine
        self.client = httpx.Client(base_url=f"http://127.0.0.1:{machine.page_port}", timeout=30)

    def wait_for_page(self) -> float:
        """Wait until the page is healthy; returns seconds since the power came."""

        def healthy() -> bool:
            try:
                return self.client.get("/api/health").status_code == 200
            except httpx.HTTPError:
                return False

        wait_for(self.machine, healthy, "the page")
        return self.machine.seconds()

    def set_up(self) -> None:
        """Be the first visitor, and get a token for what follows."""
        form = self.client.get("/login").text
        found = re.search(r'name="token" value="([^"]+)"', form)
        if found is None:
            raise ImageError("the page does not offer the first visitor to set it up:\n" + form[:2000])
        answers = {"token": found[1], "name": NAME, "password": PASSWORD, "again": PASSWORD}
        done = self.client.post("/setup", data=answers, timeout=120)
        if done.status_code != 303:
            raise ImageError(f"the set-up is refused with {done.status_code}: {done.text[:2000]}")
        self._take_token()

    def sign_in(self, name: str, password: str) -> None:
        """Be somebody whom the robot knows, and get a token for what follows."""
        done = self.client.post("/login", data={"name": name, "password": password}, timeout=120)
        if done.status_code != 303:
            raise ImageError(f"{name} cannot sign in: {done.status_code} {done.text[:2000]}")
        self._take_token()

    def _take_token(self) -> None:
        me = self.ask("GET", "/api/me")
        self.client.headers["x-csrf-token"] = str(me["csrf"])
        token = self.ask("POST", f"/api/users/{me['name']}/tokens", {"words": "trial"})["token"]
        self.client.cookies.clear()
        del self.client.headers["x-csrf-token"]
        self.client.headers["authorization"] = f"Bearer {token}"

    def ask(self, method: str, path: str, body: object = None, *, content: bytes | None = None) -> dict[str, object]:
        """A call of the API.

        Raises:
            ImageError: it is refused.
            httpx.HTTPError: nobody answers.
        """
        answer = self.client.request(method, path, json=body, content=content, timeout=900 if content else 120)
        if answer.status_code != 200:
            raise ImageError(f"{method} {path}: {answer.status_code} {answer.text[:1000]}")
        found: dict[str, object] = answer.json()
        return found


def wait_for(machine: Machine, what: Callable[[], bool], name: str, within_s: float = PATIENCE_S) -> None:
    """Wait for something of a running machine.

    Raises:
        ImageError: it does not come, or the machine goes off.
    """
    until = time.monotonic() + within_s
    while not what():
        machine.need_on()
        if time.monotonic() > until:
            raise ImageError(f"{name} does not come within {within_s:.0f} s:\n{machine.console[-4000:]}")
        time.sleep(0.5)


class Stages:
    """Notes when the console says that a stage is reached."""

    def __init__(self, machine: Machine) -> None:
        self._machine = machine
        self.seconds: dict[str, float] = {}
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._look, daemon=True)
        self._thread.start()

    def _look(self) -> None:
        while not self._over.wait(0.2):
            console = self._machine.console
            for name, pattern in STAGES.items():
                if name not in self.seconds and re.search(pattern, console):
                    self.seconds[name] = self._machine.seconds()

    def end(self) -> dict[str, float]:
        """What was reached, and when."""
        self._over.set()
        self._thread.join()
        return self.seconds


def say(words: str) -> None:
    """A line for whom waits."""
    sys.stderr.write(words + "\n")
    sys.stderr.flush()
