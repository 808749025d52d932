"""Opening, locking, closing: a real file, other connections, other processes."""

import os
import sqlite3
import subprocess
import sys
from contextlib import closing
from pathlib import Path

import pytest

from msbot.config import Blueprint, Library
from msbot.pnp import PartState
from msbot.registry import Registry, open_registry
from msbot_xrce.errors import RegistryError
from tests.registry.events import changed
from tests.registry.hand import Hand

LOCKED = (
    "is locked by another program: close the other msbot or database tool that writes to it, or choose another --db"
)


def _refused(path: Path) -> str:
    with pytest.raises(RegistryError) as caught:
        open_registry(path, busy_timeout_s=0.01)
    return str(caught.value)


def test_a_database_is_made_and_opened_again(path: Path, blueprint: Blueprint, library: Library) -> None:
    with open_registry(path) as registry:
        robot = registry.robots.apply_blueprint(blueprint, library)
        assert registry.database == str(path)
    with open_registry(f"sqlite:///{path}", create=False) as registry:
        assert registry.robots.all() == [robot]


def test_nothing_is_made_when_it_shall_not_be(path: Path) -> None:
    with pytest.raises(RegistryError, match="there is no database"):
        open_registry(path, create=False)
    with pytest.raises(RegistryError, match="there is no database"):
        open_registry(path, read_only=True)
    assert not path.exists()


@pytest.mark.parametrize("lock", ["BEGIN EXCLUSIVE", "BEGIN IMMEDIATE"])
def test_a_new_database_that_another_program_holds(path: Path, lock: str) -> None:
    with closing(sqlite3.connect(path, isolation_level=None)) as other:
        other.execute(lock)
        assert _refused(path) == f"the database {path} {LOCKED}"


def test_a_database_that_another_program_writes_can_be_read_but_not_changed(
    impatient: Registry, path: Path, blueprint: Blueprint, library: Library
) -> None:
    robot = impatient.robots.apply_blueprint(blueprint, library)
    with closing(sqlite3.connect(path, isolation_level=None)) as other:
        other.execute("BEGIN IMMEDIATE")
        assert impatient.robots.all() == [robot]
        with pytest.raises(RegistryError) as caught:
            impatient.robots.apply_blueprint(blueprint, library)
        assert str(caught.value) == f"nothing was changed: the database {path} {LOCKED}"
    impatient.robots.apply_blueprint(blueprint, library)


def test_a_running_robot_is_not_disturbed_by_a_lock(
    impatient: Registry, path: Path, blueprint: Blueprint, library: Library
) -> None:
    store = impatient.runs.begin(impatient.robots.apply_blueprint(blueprint, library))
    with closing(sqlite3.connect(path, isolation_level=None)) as other:
        other.execute("BEGIN IMMEDIATE")
        store.journal(changed(PartState.ACTIVE))
        assert not impatient.storage.flush()
        assert impatient.storage.health.trouble == (
            f"the database {path} {LOCKED}; changes kept in memory until it can be written: 1"
        )
    assert impatient.storage.flush()
    assert impatient.storage.health.trouble is None
    assert impatient.storage.health.lost == 0
    assert [part.state for part in impatient.robots.parts()] == ["active"]


def test_a_damaged_database(path: Path, blueprint: Blueprint, library: Library) -> None:
    with open_registry(path) as registry:
        registry.robots.apply_blueprint(blueprint, library)
    octets = bytearray(path.read_bytes())
    octets[100:] = b"\xff" * (len(octets) - 100)
    path.write_bytes(octets)
    assert _refused(path) == (
        f"the database {path} is damaged: move the file away and put a backup in its place, or choose another --db"
    )


def test_reading_only_changes_nothing(registry: Registry, path: Path, blueprint: Blueprint, library: Library) -> None:
    robot = registry.robots.apply_blueprint(blueprint, library)
    store = registry.runs.begin(robot)
    store.journal(changed(PartState.ACTIVE))
    registry.storage.flush()
    with open_registry(path, read_only=True) as reader:
        assert [part.state for part in reader.robots.parts(robot)] == ["active"]
        assert [entry.number for entry in reader.robots.journal()] == [1]
        assert (reader.storage.health.trouble, reader.storage.health.lost, reader.storage.flush()) == (None, 0, True)
        for write in (
            lambda: reader.robots.apply_blueprint(blueprint, library),
            lambda: reader.runs.begin(robot),
            lambda: reader.runs.node_ids(robot, "can:can0"),
            lambda: Hand(reader).block(robot, "number", "ABCD", "why", "Ann"),
        ):
            with pytest.raises(RegistryError, match="was opened for reading only"):
                write()


def test_a_registry_that_cannot_be_opened_leaves_no_thread_and_no_connection(path: Path) -> None:
    path.write_bytes(b"SQLite format 3\0 but then nothing that makes sense" * 100)
    assert "is not a database" in _refused(path) or "is damaged" in _refused(path)
    path.unlink()
    open_registry(path).close()


READER = """
import sys
from msbot.registry import open_registry

print("ready", flush=True)
last = 0
with open_registry(sys.argv[1], read_only=True) as registry:
    while last < int(sys.argv[2]):
        numbers = [entry.number for entry in registry.robots.journal(10_000)]
        assert numbers == list(range(1, len(numbers) + 1)), numbers
        assert len(numbers) >= last
        last = len(numbers)
print("read", last)
"""


def test_another_process_reads_while_this_one_writes(
    registry: Registry, path: Path, blueprint: Blueprint, library: Library
) -> None:
    store = registry.runs.begin(registry.robots.apply_blueprint(blueprint, library))
    command = [sys.executable, "-W", "error", "-c", READER, str(path), "300"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as reader:
        assert reader.stdout is not None
        assert reader.stderr is not None
        assert reader.stdout.readline() == "ready\n"
        for _ in range(300):
            store.journal(changed(PartState.ACTIVE))
            assert registry.storage.flush()
        out, err = reader.communicate(timeout=60)
    assert (out, err) == ("read 300\n", "")


def test_parts_are_lost_with_their_master(path: Path, blueprint: Blueprint, library: Library) -> None:
    with open_registry(path) as registry:
        store = registry.runs.begin(registry.robots.apply_blueprint(blueprint, library))
        store.journal(changed(PartState.ACTIVE))
        registry.storage.flush()
        with open_registry(path, read_only=True) as reader:
            assert [(part.state, part.reason) for part in reader.robots.parts()] == [("active", "because")]
    with open_registry(path, read_only=True) as reader:
        assert [(part.state, part.reason) for part in reader.robots.parts()] == [("lost", "the master has ended")]
        (*_, last) = reader.robots.journal(part="AA")
        assert last.event.sentences() == ["ABCD-local: active -> lost in slot AA: the master has ended"]


KILLED = """
import os, signal, sys
from msbot.pnp import PartState
from msbot.registry import open_registry
from tests.registry.events import changed

registry = open_registry(sys.argv[1])
store = registry.runs.begin(registry.robots.all()[0])
store.journal(changed(PartState.ACTIVE))
store.journal(changed(PartState.LEFT, slot="BB", number="EFGH", uid=b"part BB."))
registry.storage.flush()
os.kill(os.getpid(), signal.SIGKILL)
"""


def test_after_the_master_was_killed_no_part_is_shown_as_active(
    path: Path, blueprint: Blueprint, library: Library
) -> None:
    with open_registry(path) as registry:
        registry.robots.apply_blueprint(blueprint, library)
    subprocess.run([sys.executable, "-c", KILLED, str(path)], check=False)
    with open_registry(path, read_only=True) as reader:
        assert [(part.state, part.reason) for part in reader.robots.parts()] == [
            ("lost", "its robot has no master at the moment"),
            ("left", "because"),
        ]


def test_what_is_opened_to_be_changed_becomes_the_users_own_and_what_is_only_read_stays_as_it_is(path: Path) -> None:
    open_registry(path).close()
    path.chmod(0o644)
    open_registry(path, read_only=True).close()
    assert path.stat().st_mode & 0o777 == 0o644
    open_registry(path).close()
    assert path.stat().st_mode & 0o777 == 0o600


@pytest.mark.skipif(not Path("/proc/self/fd").is_dir(), reason="looks at the descriptors of a Linux process")
def test_a_database_leaves_no_descriptor_open(path: Path) -> None:
    def held() -> int:
        return sum(str(path) in os.readlink(f"/proc/self/fd/{name}") for name in _open_descriptors())

    with open_registry(path) as registry:
        registry.storage.flush()
        path.unlink()
        Hand(registry).keep_user("ada", "teacher", "ada", password_hash="hash")
        assert path.exists(), "it was written again"
        assert held() > 0
    assert held() == 0


def _open_descriptors() -> list[str]:
    return [name for name in os.listdir("/proc/self/fd") if os.path.lexists(f"/proc/self/fd/{name}")]
