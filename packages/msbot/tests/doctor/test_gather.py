"""What is looked at on a computer: the readers of the system's tables, and an examination of a real database."""

from __future__ import annotations

import importlib.metadata
import json
import os
import socket
import sqlite3
import time
from contextlib import closing
from functools import partial
from pathlib import Path

import pytest
from click.testing import CliRunner

from msbot.cli.doctor import command
from msbot.config import SAMPLE_ROBOT_TOML, load_library, parse_blueprint
from msbot.doctor import CHECKS, Check, Examined, Finding, examine
from msbot.doctor.checks.installation_checks import check_packages
from msbot.doctor.checks.robot_checks import check_robot
from msbot.doctor.checks.stop_checks import check_stop
from msbot.doctor.collectors.installation_facts import packages
from msbot.doctor.collectors.network_facts import (
    bound_ports,
    iptables_rules,
    missing_files,
    nft_rules,
    ports,
    ufw_ports,
)
from msbot.doctor.collectors.robot_facts import robot
from msbot.doctor.collectors.stop_facts import stop
from msbot.doctor.collectors.storage_facts import database, network_drive, newest_backup_s
from msbot.doctor.facts import PackageNeed
from msbot.doctor.finding import CannotSee, NotNeeded
from msbot.pnp import PartEvent, PartState
from msbot.registry import open_registry
from msbot.stop import socket_folders
from msbot_agent.space import parse_space
from msbot_xrce.errors import ConfigError

NFT = {
    "nftables": [
        {"chain": {"family": "inet", "table": "filter", "name": "input", "hook": "input", "policy": "drop"}},
        {
            "rule": {
                "chain": "input",
                "expr": [
                    {"match": {"op": "==", "left": {"payload": {"protocol": "udp", "field": "dport"}}, "right": 8888}},
                    {"accept": None},
                ],
            }
        },
        {
            "rule": {
                "chain": "input",
                "expr": [
                    {
                        "match": {
                            "op": "==",
                            "left": {"payload": {"protocol": "th", "field": "dport"}},
                            "right": {"set": [22, {"range": [8080, 8082]}]},
                        }
                    },
                    {"accept": None},
                ],
            }
        },
        {
            "rule": {
                "chain": "input",
                "expr": [
                    {"match": {"op": "==", "left": {"payload": {"protocol": "tcp", "field": "dport"}}, "right": 23}},
                    {"drop": None},
                ],
            }
        },
    ]
}
IPTABLES = """\
-P INPUT DROP
-A INPUT -p tcp -m tcp --dport 22 -j ACCEPT
-A INPUT -p udp -m multiport --dports 8888,9000:9002 -j ACCEPT
-A INPUT -p tcp -m tcp --dport 23 -j DROP
"""
SOCKETS = """\
  sl  local_address rem_address   st tx_queue rx_queue tr tm->when retrnsmt   uid  timeout inode
   0: 0100007F:1F90 00000000:0000 0A 00000000:00000000 00:00000000 00000000  1000        0 12345 1 0 100 0 0 10 0
   1: 0100007F:1F91 0100007F:9C40 01 00000000:00000000 00:00000000 00000000  1000        0 12346 1 0 100 0 0 10 0
"""


@pytest.fixture
def rover(tmp_path: Path) -> Path:
    """A database with the sample robot, which nobody runs."""
    path = tmp_path / "robot.db"
    library = load_library()
    with open_registry(path) as registry:
        registry.robots.apply_blueprint(parse_blueprint(SAMPLE_ROBOT_TOML, library=library), library)
    return path


@pytest.fixture(autouse=True)
def _alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """No master of this computer is examined."""
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))


def test_rules_of_firewalls_are_read() -> None:
    drops, found = nft_rules(json.dumps(NFT))
    assert drops
    assert found == {("udp", 8888)} | {(kind, port) for kind in ("tcp", "udp") for port in (22, 8080, 8081, 8082)}
    assert nft_rules('{"nftables": []}') == (False, set())
    drops, found = iptables_rules(IPTABLES)
    assert drops
    assert found == {("tcp", 22), ("udp", 8888), ("udp", 9000), ("udp", 9001), ("udp", 9002)}
    assert set(ufw_ports("8888/udp   ALLOW   Anywhere\n22   ALLOW   Anywhere\n23/tcp   DENY   Anywhere\n")) == {
        ("udp", 8888),
        ("tcp", 22),
        ("udp", 22),
    }


def test_a_firewall_tool_that_talks_nonsense_is_not_taken_for_an_open_door() -> None:
    for nonsense in ("", "[]", "{}", "no"):
        with pytest.raises(CannotSee):
            nft_rules(nonsense)


def test_sockets_that_wait_are_found_in_the_tables_of_the_kernel() -> None:
    assert list(bound_ports(SOCKETS, "0A")) == [(8080, "12345")]


def test_files_of_the_dds_configuration(tmp_path: Path) -> None:
    (tmp_path / "there.xml").touch()
    uri = f"file://{tmp_path}/there.xml,{tmp_path}/gone.xml,<CycloneDDS/>"
    assert missing_files({"CYCLONEDDS_URI": uri}) == (f"{tmp_path}/gone.xml",)
    assert missing_files({}) == ()


def test_a_file_below_a_mounted_folder_is_on_that_drive() -> None:
    table = [("/", "ext4"), ("/mnt/class", "nfs4"), ("/mnt/class/local", "ext4")]
    assert network_drive(Path("/mnt/class/ada/robot.db"), table) == "nfs4"
    assert network_drive(Path("/mnt/class/local/robot.db"), table) == ""
    assert network_drive(Path("/mnt/classroom/robot.db"), table) == ""


def test_the_newest_backup_is_the_one_that_counts(tmp_path: Path) -> None:
    folder = tmp_path / "backups"
    assert newest_backup_s(folder, tmp_path / "robot.db") is None
    folder.mkdir()
    assert newest_backup_s(folder, tmp_path / "robot.db") is None
    (folder / "robot-20260101-000000.db").touch()
    (folder / "other.db").touch()
    assert newest_backup_s(folder, tmp_path / "robot.db") == pytest.approx(time.time(), abs=60)


def test_a_database_in_order_and_one_that_is_locked_and_open_to_all(rover: Path) -> None:
    facts = database(Examined(str(rover)))
    assert facts.schema == facts.newest_schema
    assert (facts.is_locked, facts.others_may_read, facts.faults) == (False, False, ())
    rover.chmod(0o644)
    with closing(sqlite3.connect(rover, isolation_level=None)) as other:
        other.execute("BEGIN IMMEDIATE")
        facts = database(Examined(str(rover)))
    assert (facts.is_locked, facts.others_may_read) == (True, True)


def test_a_database_of_another_schema_is_told_and_not_read(rover: Path) -> None:
    with closing(sqlite3.connect(rover, isolation_level=None)) as other:
        other.execute("UPDATE alembic_version SET version_num = '0099'")
    facts = database(Examined(str(rover)))
    assert (facts.schema, facts.faults) == (99, ())


def test_damage_in_a_database_is_found(rover: Path) -> None:
    with closing(sqlite3.connect(rover, isolation_level=None)) as other:
        other.execute("UPDATE slots SET part_number = 'NONE-SUCH' WHERE name = 'AA'")
    assert any("NONE-SUCH" in fault for fault in database(Examined(str(rover))).faults)


def test_the_robot_of_a_database_with_its_wires_and_its_load(rover: Path) -> None:
    facts = robot(Examined(str(rover), links=("can:slcan:/dev/ttyACM0?bitrate=500000",)))
    assert (facts.is_run, facts.wire_faults, facts.bus_bitrate) == (False, {}, 500_000)
    assert 0.001 < facts.bus_load < 0.2


def test_the_same_robot_from_its_blueprint(tmp_path: Path) -> None:
    blueprint = tmp_path / "robot.toml"
    blueprint.write_text(SAMPLE_ROBOT_TOML)
    facts = robot(Examined(str(tmp_path / "robot.db"), blueprint=blueprint))
    assert facts.name == "MSBOT_MASTER"
    assert [slot.name for slot in facts.blueprint.slots] == ["AA", "BB", "CC"]


def test_one_check_that_cannot_look_keeps_no_other_from_looking() -> None:
    def blind(_: Examined) -> object:
        raise CannotSee("it is dark")

    def idle(_: Examined) -> object:
        raise NotNeeded("there is nothing")

    def broken(_: Examined) -> object:
        raise PermissionError("no")

    checks: list[Check[object]] = [
        Check("blind", blind, lambda _: []),
        Check("idle", idle, lambda _: []),
        Check("broken", broken, lambda _: []),
        Check("well", lambda patient: patient, lambda _: []),
    ]
    found = examine(Examined(None), checks=checks)
    assert found.not_seen == (("blind", "it is dark"), ("broken", "no"))
    assert found.not_needed == (("idle", "there is nothing"),)
    assert found.well == ("well",)
    assert found.is_well
    with pytest.raises(ConfigError, match="no check 'tea'"):
        examine(Examined(None), ["tea"], checks)


def test_what_has_to_be_mended_comes_before_what_is_noted() -> None:
    def finding(name: str, *, must: bool) -> Finding:
        return Finding(name, name, "it is so", "it matters", "gaps", "msbot", must=must)

    checks: list[Check[object]] = [
        Check("first", lambda patient: patient, lambda _: [finding("noted", must=False), finding("bad", must=True)]),
        Check("second", lambda patient: patient, lambda _: [finding("worse", must=True)]),
    ]
    assert [one.problem for _, one in examine(Examined(None), checks=checks).findings] == ["bad", "worse", "noted"]


def test_this_computer_can_be_examined(rover: Path) -> None:
    """Whatever it is: each check finds something, nothing, or says why it cannot look."""
    found = examine(
        Examined(str(rover), links=("udp:0.0.0.0:8888", "can:can0", "serial:/dev/nobody"), space=parse_space("dds"))
    )
    told = {name for name, _ in (*found.findings, *found.not_seen, *found.not_needed)} | set(found.well)
    assert told == {check.name for check in CHECKS}
    assert ("port-missing", "/dev/nobody") in [(finding.problem, finding.about) for _, finding in found.findings]


def test_the_command_tells_and_its_status_says_whether_there_is_something_to_mend(rover: Path) -> None:
    only = ["--only", "database,robot", "--db", str(rover)]
    done = CliRunner().invoke(command, only)
    assert done.exit_code == 0, done.output
    assert "(note) MSBOT_MASTER (robot): no master runs MSBOT_MASTER" in done.output
    assert done.output.endswith("Nothing to mend.\n")
    assert "in order" not in done.output
    assert rover.with_name("notes.db").write_text("no database")
    done = CliRunner().invoke(command, [*only[:-1], str(rover.with_name("notes.db"))])
    assert done.exit_code == 1
    assert "notes.db is not a database: some other file has this name" in done.output
    done = CliRunner().invoke(command, ["--only", "robot", "--db", str(rover.with_name("notes.db"))])
    assert done.exit_code == 0
    assert done.output.endswith("Nothing to mend in what was looked at.\n")
    rover.chmod(0o644)
    done = CliRunner().invoke(command, only)
    assert done.exit_code == 1
    assert f"    mend   chmod 600 {rover}" in done.output
    answer = json.loads(CliRunner().invoke(command, [*only, "--json"]).output)
    assert [one["problem"] for one in answer["findings"] if one["must"]] == ["readable-by-others"]
    assert answer["in_order"] == []
    assert "in order: python" in CliRunner().invoke(command, ["--only", "python", "-v"]).output


def test_a_check_that_there_is_not_is_one_sentence() -> None:
    done = CliRunner().invoke(command, ["--only", "tea"])
    assert isinstance(done.exception, ConfigError)
    assert "there are python, packages" in str(done.exception)


def test_a_package_of_an_extra_of_a_lower_distribution_is_missed(monkeypatch: pytest.MonkeyPatch) -> None:
    """`msbot[serial]` is `msbot-agent[serial]`: that msbot-agent is there does not mean that serialx is."""
    there = importlib.metadata.version

    def version(name: str) -> str:
        if name == "serialx":
            raise importlib.metadata.PackageNotFoundError(name)
        return there(name)

    monkeypatch.setattr(importlib.metadata, "version", version)
    (found,) = check_packages(packages(Examined(None, links=("serial:/dev/ttyUSB0",))))
    assert (found.about, found.mend) == ("serialx", "pip install 'msbot-agent[serial]'")
    assert not list(check_packages(packages(Examined(None))))


def test_nobody_is_sent_to_a_package_index_for_msbot_itself() -> None:
    """It is not published there, and what has its name there is somebody else's."""
    needs = (
        PackageNeed("msbot-web", "==0.1.0", "", None, fits=False),
        PackageNeed("msbot-agent", "==0.1.0", "", "0.0.9", fits=False),
    )
    assert all(not finding.mend.startswith("pip") for finding in check_packages(needs))


def test_a_port_that_this_process_has_open_is_known_as_its_own() -> None:
    """The folder of its open files changes while it is read: that one has gone again must not hide the others."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
        (page,) = ports(Examined(None, page_port=port))
    assert (page.port, page.pid) == (port, os.getpid())


def test_a_part_that_was_refused_and_then_left_is_told_of_with_the_reason_of_the_refusal(rover: Path) -> None:
    with open_registry(rover) as registry:
        record = registry.robots.all()[0]
        store = registry.runs.begin(record)
        event = partial(
            PartEvent,
            at=0.0,
            part="mole",
            slot=None,
            from_state=PartState.CHECKING,
            part_number="KNOB",
            local_name="mole",
            uid=b"the mole",
        )
        for _ in range(6):
            store.journal(event(to_state=PartState.REFUSED, reason="the slot is taken"))
        store.journal(event(to_state=PartState.LEFT, reason="session deleted"))
    facts = robot(Examined(str(rover)))
    assert facts.refused == {"mole": ("the slot is taken",) * 6}
    (finding,) = [one for one in check_robot(facts) if isinstance(one, Finding) and one.problem == "often-refused"]
    assert "6 times in the last hour: the slot is taken" in finding.saw


@pytest.mark.skipif(not socket_folders.IS_THERE, reason="this system has no such sockets")
def test_a_folder_of_stop_that_is_not_this_users_alone_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("users", "system", "shared"):
        (tmp_path / name).mkdir()
        monkeypatch.setattr(socket_folders, f"{name.upper()}_FOLDER", str(tmp_path / name))
    monkeypatch.delenv("MSBOT_STOP_GROUP", raising=False)
    name = f"{socket_folders.PREFIX}{socket_folders.own_user()}"
    assert stop(Examined(None)).odd == ()
    (tmp_path / "system" / name).chmod(0o755)
    (tmp_path / "shared" / name).symlink_to(tmp_path)
    found = {one.about: one for one in check_stop(stop(Examined(None)))}
    assert found[str(tmp_path / "system" / name)].mend == f"chmod 700 {tmp_path / 'system' / name}"
    assert "is no folder" in found[str(tmp_path / "shared" / name)].saw
