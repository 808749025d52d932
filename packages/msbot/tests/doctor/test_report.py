"""`msbot doctor --report`: a file for people who help, in which no secret stands."""

from __future__ import annotations

import getpass
import json
import secrets
import socket
from pathlib import Path

import pytest
from click.testing import CliRunner

from msbot.cli.doctor import command
from msbot.doctor import Examined, Finding
from msbot.doctor.examination import Examination
from msbot.doctor.report import OUT, Scrubber, report
from msbot.part.join.part_keys import key_text
from msbot.registry import open_registry

KEY = secrets.token_bytes(16)
SECRETS = {
    "wifi name": "Lehrerzimmer 2",
    "wifi password": "geheim und lang",
    "api token": f"msbot_{secrets.token_urlsafe(32)}",
    "page token": secrets.token_urlsafe(32),
    "entry token": secrets.token_urlsafe(16),
    "key": key_text(KEY),
    "plain key": KEY.hex(),
    "uid": secrets.token_hex(8),
    "database password": "hunter2!x",
    "world password": "sandkasten",
    "person": "anna.schmidt",
    "mail": "anna@school.example.org",
}
TEXTS = (
    "the database postgresql://msbot:{database password}@db/robot does not answer",
    "http://127.0.0.1:8080/enter?token={entry token} is refused",
    "the relay shows {api token}, which is void",
    "Authorization: Bearer {page token}",
    "the part {uid} has the key {key} ({plain key})",
    "cannot join {wifi name} with {wifi password}",
    "tcp:{world password}@192.168.1.20:7000 does not answer",
    "{person} ({mail}) has signed in",
    "token={page token}&x=1, password {database password}",
)


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with a robot's database and the file of a board."""
    board = {"link": "ws://192.168.1.20:8080", "wifi": [SECRETS["wifi name"], SECRETS["wifi password"]]}
    (tmp_path / "msbot.json").write_text(json.dumps(board | {"token": SECRETS["api token"], "key": SECRETS["key"]}))
    with open_registry(tmp_path / "robot.db") as registry:
        registry.keys.store(bytes.fromhex(SECRETS["uid"]), KEY, "ann")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_no_secret_stands_in_it(folder: Path) -> None:
    said = [text.format_map(SECRETS) for text in TEXTS]
    findings = tuple(("check", Finding("x", text, text, text, text, text, first=text)) for text in said)
    found = Examination(findings, tuple(("y", text) for text in said), tuple(("z", text) for text in said), ("python",))
    patient = Examined(str(folder / "robot.db"), links=(f"tcp:{SECRETS['world password']}@192.168.1.20:7000",))
    known = Scrubber([SECRETS["person"]])
    text = known(report(patient, found, [folder]))
    assert {what for what, secret in SECRETS.items() if secret in text} == set()
    assert text.count(OUT) > len(TEXTS)
    assert "does not answer" in text  # what helps is there
    assert "192.168.1.20" in text


def test_the_command_writes_it(folder: Path) -> None:
    (folder / "robot.toml").write_text(f"[robot]\nname = 3 # {SECRETS['wifi password']}\n")
    done = CliRunner().invoke(
        command, ["--only", "python,packages,database,disk", "--db", "robot.db", "--report", "report.md"]
    )
    assert done.exit_code in (0, 1), done.output
    text = (folder / "report.md").read_text("utf-8")
    assert text.startswith("# Report of msbot doctor\n")
    assert "(from a working tree)" in text or "(build " in text
    assert "click " in text
    own = {"computer": socket.gethostname(), "user": getpass.getuser(), "home": str(Path.home())} | SECRETS
    assert {what for what, secret in own.items() if len(secret) > 2 and f" {secret}" in text} == set()


def test_words_of_everyday_stay() -> None:
    text = "msbot-agent 0.1.0: CAN frame 0x123#0102030405060708 at 500000 bit/s on can0, slot left_wheel, 192.168.1.2"
    assert Scrubber(["ann"])(text) == text.replace("0102030405060708", OUT)
    assert Scrubber(["ann"])("the planner of ann") == f"the planner of {OUT}"
    assert Scrubber([])("at 203.0.113.7") == f"at {OUT}"
