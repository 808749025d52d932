"""`msbot topic` at a robot in another process, as somebody types it who knows `ros2 topic`."""

from __future__ import annotations

import json
import signal
from pathlib import Path

from tests.e2e.processes import run, running

TOPIC = "HelloWorldTopic_1_to_2"


def test_topics_of_a_running_robot(tmp_path: Path) -> None:
    env = {"XDG_RUNTIME_DIR": str(tmp_path), "XDG_STATE_HOME": str(tmp_path / "state")}
    assert run("init", cwd=tmp_path, env=env).returncode == 0

    def topic(*words: str) -> tuple[int, str, str]:
        done = run("topic", *words, cwd=tmp_path, env=env)
        assert "Traceback" not in done.stderr
        return done.returncode, done.stdout, done.stderr

    assert topic("list")[0] == 2
    link = ("--link", "tcp:127.0.0.1:0")
    with running("master", "robot.toml", *link, "--rec", "off", "--no-page", cwd=tmp_path, env=env) as master:
        master.wait_for("tcp:127.0.0.1:")
        assert topic("list", "-t")[:2] == (
            0,
            f"{TOPIC} [HelloWorld]\nHelloWorldTopic_2_to_3 [HelloWorld]\nHelloWorldTopic_3_to_1 [HelloWorld]\n",
        )
        assert "AA.out  (slot AA is empty)" in topic("info", "-v", TOPIC)[1]
        status, _, words = topic("echo", "HelloWorldTopic_1_to_9")
        assert status == 2
        assert TOPIC in words.partition("did you mean")[2]
        assert topic("echo", TOPIC, "--timeout", "0.2")[0] == 1
        with running("topic", "echo", f"/{TOPIC}", "--json", cwd=tmp_path, env=env) as echo:
            while not echo.waiting():  # whether it listens already, nobody tells
                assert topic("pub", TOPIC, "index=7", "message=as typed")[:2] == (
                    0,
                    f"{TOPIC}: index 7, message as typed\n",
                )
            heard = json.loads(echo.wait_for("as typed"))
            assert (heard["topic"], heard["slot"], heard["fields"]) == (TOPIC, "", {"index": 7, "message": "as typed"})
            assert echo.end(signal.SIGINT) == 0
            assert echo.lines[-1].startswith(f"{TOPIC}: ")
            assert not any("Traceback" in line for line in echo.lines)
        with running("topic", "pub", TOPIC, "1", "often", "--rate", "20", cwd=tmp_path, env=env) as often:
            often.wait_for("often")
            _, printed, _ = topic("hz", TOPIC, "-n", "1", "--json")
            assert json.loads(printed)["window"] >= 2
            assert topic("bw", TOPIC, "-n", "1")[1].count("\n") == 2
            assert run("stop", cwd=tmp_path, env=env).returncode == 0
            often.wait_for("STOP is in force")
            often.end()
        last = run("log", "follow", "--once", "-n", "5", cwd=tmp_path, env=env)
        assert (last.returncode, "STOP" in last.stdout) == (0, True), last.stderr
        with running("log", "--follow", "--json", cwd=tmp_path, env=env) as follow:
            follow.wait_for("STOP")
            assert run("go", cwd=tmp_path, env=env).returncode == 0
            assert json.loads(follow.wait_for("ended STOP"))["kind"] == "person"
            assert follow.end(signal.SIGINT) == 0
            assert not any("Traceback" in line for line in follow.lines)
