"""The robot on a card's image that runs in a virtual computer: its page, its API, and when it comes."""

from __future__ import annotations

import re
import sys
import threading
import time
from collections.abc import Callable
from typing import Any

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
HELPER_IS_SLOW = "the helper of the card does not answer"
"""What the page says when a busy computer takes long to start the helper: then it is asked again."""
DISK_IS_SLOW = re.compile(r"does not answer: try again in a moment|has not answered for \d+ s")
"""What the page says when the disk answers late: the change may have been made, or not, as one on its way."""
TRIES, PAUSE_S = 10, 2.0
"""How often a busy computer is asked again, and after how long."""
NAME, PASSWORD = "ada", "correct horse"


class Page:
    """A robot, by its API.

    Args:
        port: of its page, at this computer.
    """

    def __init__(self, port: int) -> None:
        self.client = httpx.Client(base_url=f"http://127.0.0.1:{port}", timeout=30)

    @property
    def healthy(self) -> bool:
        """Whether it answers."""
        try:
            return self.client.get("/api/health").status_code == 200
        except httpx.HTTPError:
            return False

    def ask(self, method: str, path: str, body: object = None, *, content: bytes | None = None) -> dict[str, object]:
        """A call of the API.

        Raises:
            ImageError: it is refused.
            httpx.HTTPError: nobody answers.
        """
        for _ in range(TRIES):
            answer = self.client.request(method, path, json=body, content=content, timeout=900 if content else 120)
            if content:  # an update goes on
                break
            # Only what comes to the same if it is made twice is made again.
            if HELPER_IS_SLOW not in answer.text and not (method == "PUT" and DISK_IS_SLOW.search(answer.text)):
                break
            time.sleep(PAUSE_S)
        if answer.status_code != 200:
            raise ImageError(f"{method} {path}: {answer.status_code} {answer.text[:1000]}")
        found: dict[str, object] = answer.json()
        return found

    def tokens(self, person: str) -> set[str]:
        """The API tokens of somebody."""
        people: Any = self.ask("GET", "/api/users")
        return {str(token) for one in people if one["name"] == person for token in one["tokens"]}

    def program(self, name: str) -> str | None:
        """The text of a program; None: there is none."""
        answer = self.client.get(f"/api/programs/{name}", timeout=120)
        if answer.status_code == 404:
            return None
        return str(answer.raise_for_status().json()["text"])

    def bitrate(self) -> object:
        """The bit rate that is set for a CAN hat."""
        state: Any = self.ask("GET", "/api/card")
        return state["settings"]["can_bitrate"]


class Robot(Page):
    """The robot on the card.

    Args:
        machine: where it runs.
    """

    def __init__(self, machine: Machine) -> None:
        super().__init__(machine.page_port)
        self.machine = machine

    def wait_for_page(self) -> float:
        """Wait until the page is healthy; returns seconds since the power came."""
        wait_for(self.machine, lambda: self.healthy, "the page")
        return self.machine.seconds()

    def set_up(self) -> None:
        """Be the first visitor, and get a token for what follows."""
        for tried in range(TRIES):
            form = self.client.get("/login", timeout=120).text
            found = re.search(r'name="token" value="([^"]+)"', form)
            if found is None and tried:
                return self.sign_in(NAME, PASSWORD)  # it was stored after the page had answered
            if found is None:
                raise ImageError("the page does not offer the first visitor to set it up:\n" + form[:2000])
            answers = {"token": found[1], "name": NAME, "password": PASSWORD, "again": PASSWORD}
            done = self.client.post("/setup", data=answers, timeout=120)
            if done.status_code == 303:
                return self._take_token()
            if not DISK_IS_SLOW.search(done.text):
                break
            time.sleep(PAUSE_S)
        raise ImageError(f"the set-up is refused with {done.status_code}: {done.text[:2000]}")

    def sign_in(self, name: str, password: str) -> None:
        """Be somebody whom the robot knows, and get a token for what follows."""
        done = self.client.post("/login", data={"name": name, "password": password}, timeout=120)
        if done.status_code != 303:
            raise ImageError(f"{name} cannot sign in: {done.status_code} {done.text[:2000]}")
        self._take_token()

    def _take_token(self) -> None:
        me = self.ask("GET", "/api/me")
        self.client.headers["x-csrf-token"] = str(me["csrf"])
        token = self._new_token(str(me["name"]))
        self.client.cookies.clear()
        del self.client.headers["x-csrf-token"]
        self.client.headers["authorization"] = f"Bearer {token}"

    def _new_token(self, person: str) -> str:
        """A token under a name of its own: what is told late may have been stored."""
        for number in range(TRIES):
            try:
                return str(self.ask("POST", f"/api/users/{person}/tokens", {"words": f"trial {number}"})["token"])
            except ImageError as error:
                if not DISK_IS_SLOW.search(str(error)):
                    raise
                time.sleep(PAUSE_S)
        raise ImageError(f"no token of {person} is stored, as often as it is tried")


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
