"""Calls between parts in a recording: every reader decodes them, and `log show` and `export` tell them."""

from __future__ import annotations

import asyncio
from pathlib import Path

import pytest
from click.testing import CliRunner
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory

from msbot.cli.record.log import command as log_command
from msbot.config import load_blueprint, load_library, write_sample
from msbot.master import Master
from msbot.operations.dispatch import InProcessOperations
from msbot.part import HelloWorld, Part
from msbot.process.virtual_time import run_virtual
from msbot.recording.recorder.batch import Unpacker
from msbot.recording.recorder.recorder import Recorder
from msbot.registry import open_registry
from msbot_agent.link import InprocHub, LinkInfo
from msbot_agent.space import MemorySpace
from msbot_xrce.errors import CallError
from tests.lab.recorded import BEGAN_NS, store
from tests.operations.stage import AA_IS_A_DIAL, DIAL

WIRE = """
[[binding]]
topic = "tell"
type = "HelloWorld -> HelloWorld"
from = "AA.echo"
to = []
"""


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A person calls twice; the second time the part refuses."""
    folder = tmp_path_factory.mktemp("calls")

    async def main() -> None:
        write_sample(folder / "robot.toml")
        text = (folder / "robot.toml").read_text().replace(*AA_IS_A_DIAL)
        (folder / "robot.toml").write_text(text + WIRE)
        (folder / "library").mkdir()
        (folder / "library" / "DIAL.toml").write_text(DIAL)
        library = load_library(folder / "library")
        blueprint = load_blueprint(folder / "robot.toml", library)
        loop = asyncio.get_running_loop()
        recorder = Recorder(loop.time, lambda: BEGAN_NS, library)
        with open_registry(folder / "robot.db") as registry:
            record = registry.robots.apply_blueprint(blueprint, library)
            space = recorder.space(MemorySpace(clock=loop.time))
            master = Master(blueprint, registry.runs.begin(record), epoch_ns=lambda: BEGAN_NS, space=space)
            operations = InProcessOperations(master, registry, record, library=library)
            recorder.watch(master, operations)
            hub = InprocHub()
            hub.server.info = LinkInfo("wire", 65535)
            master.add_link(hub.server)
            part = Part("DIAL", local_name="AA", uid=b"AA......")

            @part.serves("echo", HelloWorld, HelloWorld)
            def echo(request: HelloWorld) -> HelloWorld:
                if request.index > 1:
                    raise CallError("it is too much")
                return request

            async with asyncio.TaskGroup() as tasks:
                running = [tasks.create_task(master.run())]
                await master.ready.wait()
                running.append(tasks.create_task(part.run_async(hub.connect(), epoch_ns=lambda: BEGAN_NS)))
                await asyncio.sleep(3)
                await operations.do("call", who="Ada", port="AA.echo", values=["1", "hello"])
                with pytest.raises(CallError):
                    await operations.do("call", who="Ada", port="AA.echo", values=["2", "hello"])
                for task in running:
                    task.cancel()
        store(Unpacker().feed(recorder.drain()), folder / "a.mcap")

    run_virtual(main())
    return folder / "a.mcap"


def test_programs_of_others_decode_requests_and_replies(recording: Path) -> None:
    with recording.open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True, decoder_factories=[DecoderFactory()])
        topics = ["/tell_Request", "/tell_Reply", "/tell_Reply/NoReply"]
        found = [
            (channel.topic, channel.metadata.get("slot"), decoded)
            for _, channel, _, decoded in reader.iter_decoded_messages(topics=topics)
        ]
    names = ("index", "message", "status", "words")
    shown = [
        (topic, slot, {name: getattr(one, name) for name in names if hasattr(one, name)}) for topic, slot, one in found
    ]
    assert shown == [
        ("/tell_Request", None, {"index": 1, "message": "hello"}),
        ("/tell_Reply", "AA", {"index": 1, "message": "hello"}),
        ("/tell_Request", None, {"index": 2, "message": "hello"}),
        ("/tell_Reply/NoReply", "AA", {"status": 6, "words": "it is too much"}),
    ]


def test_they_are_lines_of_show_and_rows_of_export(recording: Path, tmp_path: Path) -> None:
    def log(*words: str) -> str:
        done = CliRunner().invoke(log_command, [words[0], str(recording), *words[1:]], catch_exceptions=False)
        assert done.exit_code == 0, done.output
        assert "tell" not in done.stderr, done.stderr
        return done.stdout

    shown = log("show")
    for line in ("tell_Request", "tell_Reply", "it is too much"):
        assert line in shown
    log("export", str(tmp_path / "a.csv"))
    rows = (tmp_path / "a.csv").read_text()
    assert "tell_Reply,AA,message,hello" in rows
    assert "tell_Reply/NoReply,AA,words,it is too much" in rows
