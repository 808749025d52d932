"""A robot as a service: the unit files, what is asked of systemd, and what is told. systemd itself is played."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

import pytest
from click.testing import CliRunner, Result
from hypothesis import given
from hypothesis import strategies as st

from msbot.cli import service as systemd
from msbot.cli.database_place import tell_of_password
from msbot.cli.service import RobotService, Systemd, command, quoted
from msbot.config import write_sample
from msbot.stop import socket_folders

SHOWN = "LoadState=loaded\nActiveState=active\nSubState=running\nNRestarts=2\nMainPID=77\nActiveEnterTimestamp=today\n"


class Played:
    """systemd, as far as it is asked: notes the commands and answers."""

    def __init__(self, refuse: str = "") -> None:
        self.asked: list[str] = []
        self.refuse = refuse

    def __call__(self, command: Sequence[str]) -> subprocess.CompletedProcess[str]:
        line = " ".join(command)
        self.asked.append(line)
        refused = bool(self.refuse) and self.refuse in line
        return subprocess.CompletedProcess(command, int(refused), SHOWN, "Access denied\n" if refused else "")


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    write_sample(tmp_path / "robot.toml")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "config"))
    return tmp_path


@pytest.fixture
def played(monkeypatch: pytest.MonkeyPatch) -> Played:
    found = Played()
    monkeypatch.setattr(systemd, "is_there", lambda: True)
    init = Systemd.__init__
    monkeypatch.setattr(Systemd, "__init__", lambda self, for_all: init(self, for_all=for_all, run=found))
    return found


def ask(*arguments: str) -> Result:
    return CliRunner().invoke(command, arguments)


def test_without_systemd_the_files_are_printed(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(systemd, "is_there", lambda: False)
    done = ask("install")
    assert done.exit_code == 0, done.output
    assert "This computer is not run by systemd: nothing is installed." in done.output
    assert f"# {folder}/config/systemd/user/msbot-msbot_master.service" in done.output
    assert f"-P -m msbot master {folder}/robot.toml --db {folder}/robot.db --link udp:127.0.0.1:8888" in done.output
    assert "OnCalendar=daily" in done.output
    assert not (folder / "config").exists()


def test_it_is_installed_asked_after_and_removed(folder: Path, played: Played) -> None:
    done = ask("install", "--link", "udp:0.0.0.0:8888", "--host", "0.0.0.0", "--keep", "3")
    assert done.exit_code == 0, done.output
    units = folder / "config/systemd/user"
    assert sorted(path.name for path in units.iterdir()) == [
        "msbot-msbot_master-backup.service",
        "msbot-msbot_master-backup.timer",
        "msbot-msbot_master.service",
    ]
    assert "--link udp:0.0.0.0:8888 --host 0.0.0.0" in (units / "msbot-msbot_master.service").read_text()
    assert f"db backup {folder}/backups --keep 3" in (units / "msbot-msbot_master-backup.service").read_text()
    both = "msbot-msbot_master.service msbot-msbot_master-backup.timer"
    assert played.asked == [
        "loginctl enable-linger",
        "systemctl --user daemon-reload",
        f"systemctl --user enable {both}",
        f"systemctl --user restart {both}",
    ]
    words = ask("status")
    assert "MSBOT_MASTER runs since today (process 77, restarts: 2)" in words.output
    facts = json.loads(ask("status", "--json").output)
    assert facts["running"] is True
    assert facts["database"] == f"{folder}/robot.db"
    gone = ask("remove")
    assert "will not start again" in gone.output
    assert list(units.iterdir()) == []
    assert f"systemctl --user disable --now {both}" in played.asked
    assert (folder / "robot.toml").exists()
    again = ask("remove")
    assert "is not installed as a service" in str(again.exception)
    assert ask("status").exit_code == 1


def test_a_refusal_of_systemd_is_told(folder: Path, played: Played) -> None:
    played.refuse = "enable-linger"
    done = ask("install")
    assert "`loginctl enable-linger` was refused: Access denied" in str(done.exception)


def test_what_is_wrong_is_told_before_anything_is_installed(folder: Path, played: Played) -> None:
    assert "there is no such file" in str(ask("install", "other.toml").exception)
    assert "link 'udpp:x'" in str(ask("install", "--link", "udpp:x").exception)
    assert played.asked == []


def test_masters_that_take_turns_need_a_server(folder: Path, played: Played) -> None:
    refused = ask("install", "--standby")
    assert "--standby needs a database that both masters reach" in str(refused.exception)
    assert played.asked == []
    assert ask("install", "--standby", "--db", "postgresql://ann@server/robots").exit_code == 0
    unit = (folder / "config/systemd/user/msbot-msbot_master.service").read_text()
    assert "--db postgresql://ann@server/robots --link udp:127.0.0.1:8888 --standby" in unit


def test_a_password_in_the_address_is_told_and_not_shown(folder: Path, played: Played) -> None:
    address = "postgresql://ann:secret@server:5433/robots"
    done = ask("install", "--db", address)
    assert "every user of this computer can read the password in --db" in done.output
    assert "write server:5433:robots:ann:PASSWORD into ~/.pgpass (chmod 600), or set $PGPASSWORD" in done.output
    assert "secret" not in done.output
    assert "PASSWORD" not in ask("install", "--db", "postgresql://ann@server/robots").output


def test_status_names_the_database_without_its_password() -> None:
    wanted = RobotService(
        name="R",
        python="python",
        blueprint=Path("robot.toml"),
        db="postgresql://ann:secret@server/robots",
        options=(),
        for_all=False,
        backups=Path("backups"),
        backup_at="",
        keep=1,
    )
    assert wanted.shown_db == "postgresql://ann:***@server/robots"


@pytest.mark.parametrize(
    ("address", "told"),
    [
        ("postgresql://ann@server/robots", ""),
        ("robot.db", ""),
        ("postgresql://ann:x@[", ""),
        ("postgresql:///robots?user=ann&password=x", "write *:5432:robots:*:PASSWORD into ~/.pgpass"),
        ("postgresql://ann:x@127.0.0.1/robots", "write 127.0.0.1:5432:robots:ann:PASSWORD into ~/.pgpass"),
    ],
)
def test_where_a_password_belongs(address: str, told: str, capsys: pytest.CaptureFixture[str]) -> None:
    tell_of_password(address)
    said = capsys.readouterr().err
    assert told in said
    assert bool(said) is bool(told)


def test_without_backups_there_is_no_timer(folder: Path, played: Played) -> None:
    assert ask("install", "--backup", "never").exit_code == 0
    assert [path.name for path in (folder / "config/systemd/user").iterdir()] == ["msbot-msbot_master.service"]


@pytest.mark.skipif(shutil.which("systemd-analyze") is None, reason="systemd-analyze is not installed")
def test_systemd_finds_nothing_wrong_with_the_files(tmp_path: Path) -> None:
    path = tmp_path / 'a folder "with" 100 % odd $names' / "robot.toml"
    path.parent.mkdir()
    wanted = RobotService(
        "R2 % $x",
        sys.executable,
        path,
        str(path.with_suffix(".db")),
        ("--link", "udp:0.0.0.0:0"),
        for_all=True,
        backups=tmp_path,
        backup_at="daily",
        keep=3,
    )
    for name, text in wanted.files().items():
        (tmp_path / name).write_text(text)
    files = [str(tmp_path / name) for name in wanted.files()]
    done = subprocess.run(["systemd-analyze", "verify", *files], capture_output=True, text=True, check=False)
    assert "msbot-" not in done.stderr


@given(st.text(st.characters(exclude_categories=["C", "Z"]), min_size=1))
def test_a_word_of_a_command_line_stays_one_word(word: str) -> None:
    assert unquoted(quoted(word)) == word
    assert unquoted(quoted(f"a {word} b")) == f"a {word} b"


def unquoted(text: str) -> str:
    """What systemd makes of one word: specifiers and variables doubled, C-style escapes within quotes."""
    if text.startswith('"'):
        assert text.endswith('"')
        text = text[1:-1].replace("\\\\", "\0").replace('\\"', '"').replace("\0", "\\")
    else:
        assert " " not in text
    return text.replace("%%", "%").replace("$$", "$")


def test_a_service_of_the_computer_has_a_user_of_its_own_and_no_more_than_it_needs(folder: Path) -> None:
    done = ask("install", "--system", "--print")
    assert done.exit_code == 0, done.output
    assert 'u msbot-msbot_master - "MsBOT robot MSBOT_MASTER" /var/lib/msbot-msbot_master' in done.output
    assert done.output.count("User=msbot-msbot_master\n") == 2, "the master and the backup"
    assert "--db /var/lib/msbot-msbot_master/robot.db" in done.output
    assert "ReadWritePaths" not in done.output
    # Its /tmp is hidden from root's `msbot stop`, which looks into these folders of /run.
    folders = re.findall(r"^RuntimeDirectory=(.*)$", done.output, re.MULTILINE)
    assert [one.split()[1] for one in folders] == [f"{socket_folders.PREFIX}msbot-msbot_master"] * 2
    assert done.output.count("RuntimeDirectoryMode=0700\n") == 2, "else it does not count"
    elsewhere = ask("install", "--system", "--print", "--db", "data/robot.db").output
    assert elsewhere.count(f"ReadWritePaths={folder}/data\n") == 2
    assert "User=" not in ask("install", "--print").output


@pytest.mark.skipif(shutil.which("systemd-analyze") is None, reason="no systemd here: apt-get install systemd")
def test_systemd_itself_finds_that_service_well_confined(folder: Path) -> None:
    service = RobotService(
        "R: x",
        sys.executable,
        folder / "robot.toml",
        "/var/lib/msbot-r-x/robot.db",
        ("--port", "8080"),
        for_all=True,
        backups=Path("/var/lib/msbot-r-x/backups"),
        backup_at="daily",
        keep=3,
        groups=("dialout",),
    )
    for name, text in service.files().items():
        (folder / name).write_text(text)
    for name in ("msbot-r-x.service", "msbot-r-x-backup.service"):
        told = subprocess.run(
            ["systemd-analyze", "security", "--offline=true", "--threshold=30", "--no-pager", str(folder / name)],
            capture_output=True,
            text=True,
            check=False,
        )
        assert told.returncode == 0, told.stdout[-200:] + told.stderr
        assert "Overall exposure level" in told.stdout
        verified = subprocess.run(
            ["systemd-analyze", "verify", "--man=no", str(folder / name)], capture_output=True, text=True, check=False
        )
        assert not [line for line in verified.stderr.splitlines() if str(folder / name) in line], verified.stderr


def test_what_its_user_could_not_read_is_told_before_anything_is_installed(folder: Path, played: Played) -> None:
    (folder / "robot.toml").chmod(0o600)
    told = str(ask("install", "--system").exception)
    assert "the service runs as the user msbot-msbot_master, who cannot read" in told
    assert "put the robot and the environment of MsBOT under /srv or /opt" in told
    assert played.asked == []


@pytest.mark.promise("Other users of the computer change nothing that a program of MsBOT runs")
@pytest.mark.parametrize("for_all", [False, True])
def test_units_are_changed_by_who_installed_them_only_whatever_the_umask_is(
    folder: Path, played: Played, monkeypatch: pytest.MonkeyPatch, *, for_all: bool
) -> None:
    monkeypatch.setattr(systemd, "USERS", folder / "sysusers.d")
    before = os.umask(0)
    try:
        manager = Systemd(for_all=for_all)
        if for_all:
            manager.folder = folder / "units"
            manager.folder.mkdir(mode=0o755)
            (manager.folder / "msbot-x.service").write_text("an earlier one, longer than what takes its place")
        manager.install({"msbot-x.service": "[Service]"}, ["msbot-x.service"], "u" if for_all else "")
    finally:
        os.umask(before)
    assert (manager.folder / "msbot-x.service").read_text() == "[Service]"
    made = [path for path in folder.rglob("*") if path.name != "robot.toml"]
    assert len(made) == 4
    assert [str(path) for path in made if path.stat().st_mode & 0o022] == []


def test_it_is_installed_with_its_user(
    folder: Path, played: Played, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(systemd, "USERS", tmp_path / "sysusers.d")
    manager = Systemd(for_all=True)
    manager.folder = tmp_path / "units"
    manager.install({"msbot-x.service": "[Service]"}, ["msbot-x.service"], 'u msbot-x - "x" /var/lib/msbot-x')
    assert (tmp_path / "sysusers.d" / "msbot-x.conf").read_text().startswith("u msbot-x ")
    assert played.asked[0] == "systemd-sysusers"
    assert played.asked[-1] == "systemctl restart msbot-x.service"
