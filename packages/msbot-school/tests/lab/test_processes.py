"""The flight recorder of real programs: killed, stopped, saved, looked into."""

import json
import os
import signal
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from rosbags.rosbag2 import Reader

from msbot.recording.recorder.recording_file import begun_segments, segment_name, segments
from msbot.recording.recordings.mcap_reader import RecordedMessage, RecordingReader
from tests.e2e.processes import Process, run, running

PATIENCE_S = 90.0
ANY_PORT = ["--link", "udp:127.0.0.1:0"]


@pytest.fixture
def robot(tmp_path: Path) -> Iterator[tuple[Process, dict[str, str], Path]]:
    """A master whose recorder is on, with one part, and the folder of its ring."""
    (tmp_path / "run").mkdir(mode=0o700)
    env = {"XDG_STATE_HOME": str(tmp_path / "state"), "XDG_RUNTIME_DIR": str(tmp_path / "run"), "MSBOT_REC": "10min"}
    assert run("init", cwd=tmp_path, env=env).returncode == 0
    with running("master", "--no-page", *ANY_PORT, cwd=tmp_path, env=env) as master:
        link = link_of(master)
        with running("part", "AA", "--link", link, cwd=tmp_path, env=env):
            master.wait_for("-> active")
            status = json.loads(run("rec", "list", "--json", cwd=tmp_path, env=env).stdout)
            yield master, env, Path(status["folder"])


def link_of(master: Process) -> str:
    """Where parts of a new master find it."""
    return master.wait_for("is up on").partition("is up on ")[2].partition(";")[0]


def until(found: Callable[[], bool]) -> None:
    """Wait for something that another process does."""
    patience = time.monotonic() + PATIENCE_S
    while not found():
        assert time.monotonic() < patience
        time.sleep(0.05)


def in_ring(folder: Path) -> list[RecordedMessage]:
    """What the ring's files hold at the moment."""
    if not folder.is_dir():
        return []
    return [message for segment in begun_segments(folder) for message in RecordingReader(segment.path).messages()]


def test_a_killed_master_leaves_a_recording_that_is_whole(
    robot: tuple[Process, dict[str, str], Path], tmp_path: Path
) -> None:
    master, env, folder = robot
    until(lambda: any(b"-> active" in one.data for one in in_ring(folder)))
    before_ns = max(one.at_ns for one in in_ring(folder))
    until(lambda: max(one.at_ns for one in in_ring(folder)) > before_ns + 10**9)
    newest = max(in_ring(folder), key=lambda one: one.at_ns)
    master.end(signal.SIGKILL)

    def is_whole() -> bool:
        reader = RecordingReader(segments(folder)[-1].path)
        for _ in reader.messages():
            pass
        return not reader.damage

    until(is_whole)  # the recorder has written the end of its file
    assert newest in in_ring(folder)
    shown = run("log", "show", str(segments(folder)[-1].path), cwd=tmp_path, env=env)
    assert "active in slot AA" in shown.stdout
    assert all(line.startswith("left out, since the recording does not tell") for line in shown.stderr.splitlines())
    listed = run("rec", "list", cwd=tmp_path, env=env).stdout
    assert f"No master runs here; this is left of earlier ones:\nThe ring is in {folder}: " in listed
    (left,) = json.loads(run("rec", "list", "--json", cwd=tmp_path, env=env).stdout)["left"]
    assert left["folder"] == str(folder)
    assert [one["name"] for one in left["files"]] == [segment.path.name for segment in segments(folder)]
    (folder / segment_name(time.time_ns(), 999_999)).touch(0o600)  # as of a recorder that is killed in a new file
    saved = run("rec", "save", "left", cwd=tmp_path, env=env)
    assert saved.returncode == 0, saved.stderr
    assert any(b"-> active" in one.data for one in RecordingReader(tmp_path / "left.mcap").messages())
    assert (tmp_path / "left.mcap").stat().st_mode & 0o077 == 0
    bag = run("rec", "save", "bag", "--ros2", cwd=tmp_path, env=env)
    assert (bag.returncode, "left out, for they are no ROS 2 messages: /msbot/" in bag.stdout) == (0, True), bag.stderr
    assert all(one.is_ros for one in RecordingReader(tmp_path / "bag.mcap").messages())
    elsewhere = run("rec", "save", "left", "--robot", "Elsewhere", cwd=tmp_path, env=env)
    assert (elsewhere.returncode, "no recorder has left a ring" in elsewhere.stderr) == (2, True)
    (folder.parent / "Twin-01234567").mkdir()
    which = run("rec", "save", "one", cwd=folder, env=env)
    assert (which.returncode, "2 robots have left a ring: say which one is meant" in which.stderr) == (2, True)
    assert folder.name in which.stderr
    assert folder.stat().st_mode & 0o077 == 0
    assert all(segment.path.stat().st_mode & 0o077 == 0 for segment in segments(folder))


def test_a_killed_recorder_leaves_what_it_wrote_and_another_one_goes_on(
    robot: tuple[Process, dict[str, str], Path], tmp_path: Path
) -> None:
    master, env, folder = robot
    until(lambda: any(b"-> active" in one.data for one in in_ring(folder)))
    (recorder,) = children(master.pid)
    os.kill(recorder, signal.SIGKILL)
    master.wait_for("the recorder has ended; another one is started")
    until(lambda: len(begun_segments(folder)) == 2)
    first, second = (segment.path for segment in segments(folder))
    assert any(b"-> active" in one.data for one in RecordingReader(first).messages())

    def knows_the_slot() -> bool:
        found = [one for one in RecordingReader(second).messages() if one.topic == "/msbot/slots"]
        return {json.loads(one.data)["slot"] for one in found} == {"AA"}  # more than once, if it was lost meanwhile

    until(knows_the_slot)
    until(lambda: any(one.topic == "/msbot/recorder" for one in RecordingReader(second).messages()))
    saved = run("rec", "save", "all", cwd=tmp_path, env=env)
    assert saved.returncode == 0, saved.stderr
    assert (tmp_path / "all.mcap").exists()
    assert run("rec", "save", "all", cwd=tmp_path, env=env).returncode == 2


def test_recording_starts_and_stops_while_the_robot_runs(
    robot: tuple[Process, dict[str, str], Path], tmp_path: Path
) -> None:
    _, env, _ = robot
    started = run("rec", "start", "lesson", cwd=tmp_path, env=env)
    assert started.stdout.strip().endswith("lesson.mcap from now on")
    instead = run("rec", "start", "instead", cwd=tmp_path, env=env).stdout
    assert instead.startswith(f"{tmp_path}/lesson.mcap is complete; everything is recorded in {tmp_path}/instead.mcap")
    assert "instead.mcap" in run("rec", "list", cwd=tmp_path, env=env).stdout
    assert run("stop", cwd=tmp_path, env=env).returncode == 0
    assert run("rec", "stop", cwd=tmp_path, env=env).stdout == f"{tmp_path}/instead.mcap is complete\n"
    path = tmp_path / "instead.mcap"
    reader = RecordingReader(path)
    assert "/msbot/acts" in [one.topic for one in reader.messages()]
    assert not reader.damage  # it is complete when the command says so
    assert "STOP by" in run("log", "show", str(path), "--topic", "msbot/stop", cwd=tmp_path, env=env).stdout
    refused = run("rec", "stop", cwd=tmp_path, env=env)
    assert refused.returncode == 2
    assert "nothing is recorded but the ring" in refused.stderr
    exists = run("rec", "start", "lesson", cwd=tmp_path, env=env)
    assert exists.returncode == 2
    assert "is there already" in exists.stderr
    for _ in range(2):  # /proc takes no files, not even root's; the second time is told as well
        unwritable = run("rec", "start", "/proc/lesson", cwd=tmp_path, env=env)
        assert unwritable.returncode == 2
        assert "/proc/lesson.mcap cannot be written" in unwritable.stderr
        assert "nothing is recorded there" in unwritable.stderr


@pytest.mark.promise(
    "What the recorder writes with --ros2 is a bag that ROS 2's own readers take, and what is not in it is named"
)
def test_a_bag_is_written_while_the_robot_runs_also_by_a_recorder_that_follows_a_killed_one(tmp_path: Path) -> None:
    (tmp_path / "run").mkdir(mode=0o700)
    env = {"XDG_STATE_HOME": str(tmp_path / "state"), "XDG_RUNTIME_DIR": str(tmp_path / "run")}
    assert run("init", cwd=tmp_path, env=env).returncode == 0
    blueprint = tmp_path / "robot.toml"
    line = 'topic = "HelloWorldTopic_1_to_2"\n'
    blueprint.write_text(blueprint.read_text().replace(line, f"{line}ros = true\n"))
    with running("master", "--no-page", "--rec", "first.mcap,ros2", *ANY_PORT, cwd=tmp_path, env=env) as master:
        with running("part", "AA", "--link", link_of(master), cwd=tmp_path, env=env):
            master.wait_for("-> active")
            listed = run("rec", "list", cwd=tmp_path, env=env).stdout
            assert f"What ROS 2 can read is recorded in {tmp_path}/first.mcap, too.\n" in listed
            until(lambda: bool(greetings(tmp_path / "first.mcap")))
            begun = run("rec", "start", "second", "--ros2", cwd=tmp_path, env=env).stdout
            assert begun.startswith(
                f"{tmp_path}/first.mcap is complete; left out, for they are no ROS 2 messages: /msbot/"
            )
            assert begun.endswith(f"what ROS 2 can read is recorded in {tmp_path}/second.mcap from now on\n")
            assert topics_of_bag(tmp_path / "first.mcap")[GREETINGS] == "std_msgs/msg/String"
            (recorder,) = children(master.pid)
            os.kill(recorder, signal.SIGKILL)
            third = tmp_path / "second-2.mcap"
            until(lambda: bool(greetings(third)))
            ended = run("rec", "stop", cwd=tmp_path, env=env).stdout
            assert ended.startswith(f"{third} is complete; left out, for they are no ROS 2 messages: /msbot/")
            assert topics_of_bag(third)[GREETINGS] == "std_msgs/msg/String"
            mended = run("log", "filter", "second.mcap", "mended.mcap", "--ros2", cwd=tmp_path, env=env)
            assert (mended.returncode, "second.mcap is damaged: " in mended.stderr) == (1, True)
            assert topics_of_bag(tmp_path / "mended.mcap")[GREETINGS] == "std_msgs/msg/String"
        master.end()


GREETINGS = "/MSBOT_MASTER/HelloWorldTopic_1_to_2"


def greetings(path: Path) -> list[RecordedMessage]:
    """What is in a bag so far of the topic that ROS 2 has."""
    found = RecordingReader(path).messages() if _begun(path) else ()
    return [one for one in found if one.topic == GREETINGS]


def topics_of_bag(path: Path) -> dict[str, str]:
    """Topics and types of a bag that has messages, as a reader of others finds them."""
    with Reader(path) as reader:
        assert reader.message_count > 0
        return {topic: str(info.msgtype) for topic, info in reader.topics.items()}


def test_off_is_off(tmp_path: Path) -> None:
    env = {"XDG_STATE_HOME": str(tmp_path / "state"), "XDG_RUNTIME_DIR": str(tmp_path / "run")}
    (tmp_path / "run").mkdir(mode=0o700)
    assert run("init", cwd=tmp_path, env=env).returncode == 0
    with running("master", "--no-page", "--rec", "off", *ANY_PORT, cwd=tmp_path, env=env) as master:
        master.wait_for("is up on")
        assert children(master.pid) == []
        assert "nothing is recorded" in run("rec", "list", cwd=tmp_path, env=env).stdout
        saved = run("rec", "save", "x", cwd=tmp_path, env=env)
        assert (saved.returncode, "nothing was recorded" in saved.stderr) == (2, True)
    wrong = run("master", "--rec", "ten", cwd=tmp_path, env=env)
    assert wrong.returncode == 2
    assert "say how much to keep" in wrong.stderr


def children(pid: int) -> list[int]:
    """The processes that a process has started."""
    found = []
    for task in Path(f"/proc/{pid}/task").iterdir():
        found += [int(word) for word in (task / "children").read_text().split()]
    return found


def test_what_a_part_said_is_replayed_in_its_place(tmp_path: Path) -> None:
    (tmp_path / "run").mkdir(mode=0o700)
    env = {"XDG_STATE_HOME": str(tmp_path / "state"), "XDG_RUNTIME_DIR": str(tmp_path / "run")}
    assert run("init", cwd=tmp_path, env=env).returncode == 0
    with running("master", "--no-page", "--rec", "first.mcap", *ANY_PORT, cwd=tmp_path, env=env) as master:
        with running("part", "AA", "--link", link_of(master), cwd=tmp_path, env=env):
            until(lambda: len(said_by_aa(tmp_path / "first.mcap")) >= 3)
            assert run("unbind", "HelloWorldTopic_1_to_2", "BB.in", cwd=tmp_path, env=env).returncode == 0
            again = ("bind", "HelloWorldTopic_1_to_2", "--type", "HelloWorld", "--to", "BB.in")
            assert run(*again, cwd=tmp_path, env=env).returncode == 0
            until(lambda: len(acts_in(tmp_path / "first.mcap")) == 2)
        master.end()
    with running("master", "--no-page", "--rec", "again.mcap", *ANY_PORT, cwd=tmp_path, env=env) as master:
        played = run("play", "first.mcap", "--speed", "10", "--link", link_of(master), cwd=tmp_path, env=env)
        assert played.returncode == 0, played.stderr
        assert "AA (ABCD): " in played.stdout
        assert ", 10 times as fast\n" in played.stdout  # how fast that is, is tested in virtual time
        assert "The replay is over: " in played.stdout
        played = run("play", "first.mcap", "--acts", cwd=tmp_path, env=env)
        assert played.returncode == 0, played.stderr
        assert "The replay of acts is over: 2 acts done\n" in played.stdout
        until(lambda: len(acts_in(tmp_path / "again.mcap")) == 2)
        master.end()
    told, told_again = (acts_in(tmp_path / name) for name in ("first.mcap", "again.mcap"))
    assert told_again == [{**act, "who": f"{act['who']}, replayed"} for act in told]
    wrong = run("play", "first.mcap", "--acts", cwd=tmp_path, env=env)
    assert (wrong.returncode, "no master runs here" in wrong.stderr) == (2, True)
    said, said_again = (said_by_aa(tmp_path / name) for name in ("first.mcap", "again.mcap"))
    assert [one.data for one in said_again] == [one.data for one in said]
    # A tenth on a quiet computer; how exactly the times are kept is tested in virtual time.
    assert said_again[-1].at_ns - said_again[0].at_ns < said[-1].at_ns - said[0].at_ns
    wrong = run("play", "first.mcap", "--slot", "XX", cwd=tmp_path, env=env)
    assert (wrong.returncode, wrong.stderr) == (2, "msbot: first.mcap has no slot 'XX'; there are AA\n")


def _begun(path: Path) -> bool:
    """Whether something is in it: a file is empty for a moment."""
    return path.exists() and path.stat().st_size > 0


def acts_in(path: Path) -> list[dict[str, object]]:
    """What people did."""
    found = RecordingReader(path).messages() if _begun(path) else ()
    return [json.loads(one.data) for one in found if one.topic == "/msbot/acts" and not one.is_repeated]


def said_by_aa(path: Path) -> list[RecordedMessage]:
    """What the part in slot AA published."""
    if not _begun(path):
        return []
    return [one for one in RecordingReader(path).messages() if one.slot == "AA" and not one.is_repeated]
