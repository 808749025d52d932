"""Who a STOP is meant for, and how it gets there: all masters of the user, or those of one group."""

from __future__ import annotations

import errno
import json
import os
import socket
from contextlib import ExitStack
from pathlib import Path
from threading import Event, Thread
from typing import Any

import pytest

from msbot.stop import socket_folders
from msbot.stop import stop_listener as stop_abstract
from msbot.stop import stop_request as stop_asking
from msbot.stop.socket_folders import IS_LINUX, IS_THERE, own_folder
from msbot.stop.socket_names import GROUP_VARIABLE, group_to_stop, name_in, new_name
from msbot.stop.stop_listener import listen
from msbot.stop.stop_request import MOST_AT_ONCE, ask_masters
from msbot_xrce.errors import ConfigError
from tests.runtime.stop_stage import PATIENCE_S, StopsWhen, master, own_places, stuck_master, taken

pytestmark = pytest.mark.skipif(not IS_THERE, reason="this system has no Unix sockets")
needs_linux = pytest.mark.skipif(not IS_LINUX, reason="names of sockets without files are known to Linux only")
STOP = {"do": "stop", "who": "ann"}
ANSWER: dict[str, object] = {"meant": True, "robot": "R", "user": os.geteuid() if hasattr(os, "geteuid") else 0}


@pytest.fixture(autouse=True)
def shared(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Everybody's folder; nothing in the environment says a group."""
    monkeypatch.delenv(GROUP_VARIABLE)
    return own_places(tmp_path, monkeypatch)


def no_room_in(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """No folder can be had there: it is no place for any."""
    gone = folder / "gone"
    monkeypatch.setattr(socket_folders, "SHARED_FOLDER", str(gone))


def test_a_group_stops_its_own_and_nobody_else_and_all_means_all(monkeypatch: pytest.MonkeyPatch) -> None:
    with master(taken, group="a") as one, master(taken, group="b") as other, master(taken) as none:
        assert ask_masters(STOP, PATIENCE_S, group="a") == ([ANSWER], [])
        assert (len(one), len(other), len(none)) == (1, 0, 0)
        monkeypatch.setenv(GROUP_VARIABLE, "b")
        assert ask_masters(STOP, PATIENCE_S) == ([ANSWER], [])
        assert (len(one), len(other), len(none)) == (1, 1, 0)
        assert ask_masters(STOP, PATIENCE_S, group="") == ([ANSWER] * 3, [])
        assert (len(one), len(other), len(none)) == (2, 2, 1)


def test_what_is_no_group_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(GROUP_VARIABLE, "bench 1")
    with pytest.raises(ConfigError, match="MSBOT_STOP_GROUP: 'bench 1' is no name for a STOP group: it has at most 24"):
        ask_masters(STOP)
    group, words = group_to_stop()
    assert group == ""
    assert words.startswith("$MSBOT_STOP_GROUP: 'bench 1' is no name")


@pytest.mark.parametrize("place", [{"HOME": "/elsewhere"}, {"XDG_RUNTIME_DIR": "/elsewhere"}, {"TMPDIR": "/elsewhere"}])
def test_nothing_in_the_environment_keeps_masters_apart(place: dict[str, str], monkeypatch: pytest.MonkeyPatch) -> None:
    with master(taken):
        for name, value in place.items():
            monkeypatch.setenv(name, value)
        assert ask_masters(STOP, PATIENCE_S) == ([ANSWER], [])


def test_a_master_that_does_not_answer_is_named_and_keeps_no_other_from_answering(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    clock = StopsWhen(monkeypatch)
    with stuck_master("ROVER X9"), master(taken):
        clock.answers_wanted = 1
        answers, (silent,) = ask_masters(STOP, PATIENCE_S)
        assert answers == [ANSWER]
        assert str(silent) == f"ROVER X9 (process {os.getpid()})"
    for robot in ("BUGGY", "X1"):
        with stuck_master("ROVER X9", database="/a.db"), pytest.MonkeyPatch.context() as patch:
            StopsWhen(patch).tries_wanted = 1
            assert ask_masters({**STOP, "robot": robot}, PATIENCE_S) == ([], []), "it is not meant, nor asked"
            assert ask_masters({**STOP, "database": "/b.db"}, PATIENCE_S) == ([], [])
    for meant in ({"robot": "ROVER"}, {"robot": "X9"}, {"database": "/a.db"}):
        with stuck_master("ROVER X9", database="/a.db"), pytest.MonkeyPatch.context() as patch:
            StopsWhen(patch).tries_wanted = 1
            assert len(ask_masters({**STOP, **meant}, PATIENCE_S)[1]) == 1


def test_a_full_queue_is_waited_for_and_one_that_stays_full_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    """Only programs of the user can fill it; they do not keep a STOP out as long as the master takes connections."""
    with stuck_master("ROVER X9") as stuck, ExitStack() as held:
        filled = []
        while True:
            one = held.enter_context(socket.socket(socket.AF_UNIX, socket.SOCK_STREAM))
            one.setblocking(False)
            assert stuck.folder is not None
            try:
                one.connect(stuck.folder.address(str(stuck.name)))
            except BlockingIOError:
                break
            filled.append(one)
        clock = StopsWhen(monkeypatch)
        clock.tries_wanted = 3
        answers, (silent,) = ask_masters(STOP, PATIENCE_S)
        assert (answers, str(silent)) == ([], f"ROVER X9 (process {os.getpid()})")


def test_a_connection_that_is_closed_without_an_answer_is_made_anew_but_not_for_go() -> None:
    def closes_twice(request: dict[str, Any]) -> bytes:
        return b"" if len(heard) < 3 else taken(request)

    with master(closes_twice) as heard:
        assert ask_masters(STOP, PATIENCE_S) == ([ANSWER], [])
        assert len(heard) == 3
        heard.clear()
        answers, silent = ask_masters({**STOP, "do": "go"}, PATIENCE_S)
        assert (answers, len(silent), len(heard)) == ([], 1, 1)


@pytest.mark.parametrize(
    "answer", [b"nonsense\n", b"[" * 100_000 + b"\n", b'{"meant": true, "nonce": "another"}\n', b"x" * (1 << 19)]
)
def test_an_answer_to_nothing_that_was_asked_is_none(answer: bytes) -> None:
    with master(lambda _request: answer, "R 1"):
        answers, (silent,) = ask_masters(STOP, PATIENCE_S)
        assert (answers, str(silent)) == ([], f"R 1 (process {os.getpid()})")


def test_sockets_of_killed_masters_are_removed_by_whoever_finds_them(shared: Path) -> None:
    folder = own_folder()
    for number in range(3):
        with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as dead:
            dead.bind(folder.address(str(new_name(f"R {number}", ""))))
    (place,) = shared.iterdir()
    assert len(list(place.iterdir())) == 3
    assert ask_masters(STOP, PATIENCE_S) == ([], [])
    assert list(place.iterdir()) == []
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as dead:
        dead.bind(folder.address(str(new_name("R 4", ""))))
    folder.close()
    with stuck_master():
        assert len(list(place.iterdir())) == 1, "a master that starts removes them, too"
    assert list(place.iterdir()) == []


def test_what_is_no_socket_of_ours_is_left_alone(shared: Path) -> None:
    with master(taken):
        (place,) = shared.iterdir()
        (place / "1-ab.g.00000000.file").write_text("a file with a name of ours")
        (place / "1-cd.g.00000000.link").symlink_to(place / "nothing")
        (place / os.fsdecode(b"1-ef.g.00000000.\xff\xfe")).write_text("")
        (place / "1-gh.g.00000000.folder").mkdir()
        os.mkfifo(place / "1-ij.g.00000000.pipe")
        assert ask_masters(STOP, PATIENCE_S) == ([ANSWER], [])
        (place / "1-ij.g.00000000.pipe").unlink()
        assert (place / "1-ab.g.00000000.file").exists()


@pytest.mark.parametrize("mode", [0o755, 0o770, 0o707, 0o722])
def test_a_folder_that_others_may_use_is_none(mode: int, shared: Path) -> None:
    with master(taken) as heard:
        (place,) = shared.iterdir()
        place.chmod(mode)
        assert ask_masters(STOP, PATIENCE_S) == ([], [])
        own_folder().close()
        assert len(list(shared.iterdir())) == 2, "another name is free"
        place.chmod(0o700)
        assert ask_masters(STOP, PATIENCE_S) == ([ANSWER], [])
        assert len(heard) == 1


def test_a_link_in_place_of_the_folder_is_none(shared: Path, tmp_path: Path) -> None:
    (tmp_path / "mine").mkdir(mode=0o700)
    (shared / f"msbot-stop-{socket_folders.own_user()}").symlink_to(tmp_path / "mine")
    with master(taken):
        assert ask_masters(STOP, PATIENCE_S) == ([ANSWER], [])
    assert list((tmp_path / "mine").iterdir()) == []


@needs_linux
def test_without_any_folder_an_abstract_name_remains(shared: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    no_room_in(shared, monkeypatch)
    with master(taken, group=f"g{os.getpid()}"):
        assert ask_masters(STOP, PATIENCE_S, group=f"g{os.getpid()}") == ([ANSWER], [])


@needs_linux
def test_names_of_any_octets_that_others_have_taken_are_survived(shared: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What a system tells of its sockets is whatever anybody has written: octets that are no text, line breaks."""
    no_room_in(shared, monkeypatch)
    group = f"g{os.getpid()}"
    start = stop_abstract.abstract_address(socket_folders.own_user(), "").encode()
    with ExitStack() as held, master(taken, group=group):
        for name in (b"\xff\xfe", b"1-ab." + group.encode() + b".00000000.\n\xff", b"a b\n@\0", b"\0" * 40, b"~zz"):
            one = held.enter_context(socket.socket(socket.AF_UNIX, socket.SOCK_STREAM))
            one.bind(start + name)
            one.listen()
        assert ask_masters(STOP, PATIENCE_S, group=group) == ([ANSWER], [])


def test_more_masters_than_connections_are_all_asked(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(stop_asking, "MOST_AT_ONCE", 2)
    assert MOST_AT_ONCE > 100
    with ExitStack() as running:
        heard = [running.enter_context(master(taken, f"R {number}")) for number in range(7)]
        answers, silent = ask_masters(STOP, PATIENCE_S)
        assert (len(answers), silent) == (7, [])
        assert [len(one) for one in heard] == [1] * 7


def test_without_threads_they_are_asked_all_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(_thread: object) -> None:
        raise RuntimeError("can't start new thread")

    with master(taken):
        monkeypatch.setattr(Thread, "start", refuse)
        assert ask_masters(STOP, PATIENCE_S) == ([ANSWER], [])


def test_a_place_that_does_not_answer_delays_no_other_and_is_said(
    shared: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """For example a file system of somebody else's making."""
    goes_on = Event()
    hanging = f"{shared}/msbot-stop-{socket_folders.own_user()}-x"

    def slow(path: str, owner: int) -> socket_folders.StopFolder | None:
        if path == hanging:
            goes_on.wait(PATIENCE_S)
        return opened(path, owner)

    opened = socket_folders.open_folder
    with master(taken):
        os.mkdir(hanging, 0o755)
        monkeypatch.setattr(socket_folders, "open_folder", slow)
        clock = StopsWhen(monkeypatch)
        clock.answers_wanted = 1
        answers, silent = ask_masters(STOP, PATIENCE_S)
        goes_on.set()
        assert answers == [ANSWER]
        assert f"whatever has its socket in {shared}" in map(str, silent)


def test_a_full_disk_leaves_nothing_half_made(shared: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_args: object, **_names: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr("msbot.stop.stop_listener.os.rename", full)
    group = f"g{os.getpid()}"
    if IS_LINUX:
        with stuck_master(group=group) as listener:
            assert listener.folder is None
            assert [name for name, _ in stop_abstract.abstract_names(socket_folders.own_user())] != []
            assert not listener.is_in_place()
    else:
        with pytest.raises(OSError, match="No space"):
            listen(new_name("R", group))
    (place,) = shared.iterdir()
    assert list(place.iterdir()) == []


@pytest.mark.parametrize("robot", ["ROVER X1", "Ü~/..\n\0 1", "a" * 300, "\ud800 1", "", "日本語のロボット X1"])
def test_names_say_which_robot_it_is_in_few_octets(robot: str) -> None:
    name = new_name(robot, "b" * 24, "/somewhere/robot.db")
    text = str(name)
    assert text.isascii()
    assert len(text) <= 80
    assert "/" not in text
    assert "\n" not in text
    read = name_in(text)
    assert read is not None
    assert (read.pid, read.group, read.database) == (name.pid, name.group, name.database)
    assert robot.encode("utf-8", "replace").decode().startswith(read.robot)
    assert read.may_be(robot.rpartition(" ")[0] or None, "/somewhere/robot.db")
    assert not read.may_be(None, "/somewhere/else.db")


@pytest.mark.parametrize("text", ["", "x", "1-a.g.d", "-a.g.d.r", "1-.g.d.r", "99999999999-a.g.d.r", "1-ä.g.d.r"])
def test_other_names_are_none_of_ours(text: str) -> None:
    assert name_in(text) is None


def test_the_line_of_a_request_is_one(monkeypatch: pytest.MonkeyPatch) -> None:
    with master(taken) as heard:
        ask_masters({**STOP, "reason": "two\nlines"}, PATIENCE_S)
        (request,) = heard
        assert request["reason"] == "two\nlines"
        assert isinstance(request["expires"], float)
        assert json.dumps(request)
