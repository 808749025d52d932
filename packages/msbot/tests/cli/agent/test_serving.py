"""What `msbot agent` does around an agent; the whole of it runs in tests/e2e."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Iterator
from pathlib import Path

import pytest

from msbot_agent.cli.agent import serving
from msbot_agent.cli.agent.serving import ServingOptions, read_references
from msbot_agent.link import Signal
from msbot_agent.link.net import UdpServerLink
from msbot_agent.process.user_folders import PACKAGES
from msbot_xrce.errors import ConfigError, LinkDown
from msbot_xrce.messages import ObjectKind
from tests.agent.wiring import FakeLink

PROFILES = """<profiles><participant profile_name="default"><rtps><name>p</name></rtps></participant></profiles>"""


@pytest.fixture(autouse=True)
def _own_place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Status files of these agents are nobody's business; levels of logging are put back."""
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    loggers = [logging.getLogger(), *map(logging.getLogger, PACKAGES)]
    levels = [logger.level for logger in loggers]
    yield
    for logger, level in zip(loggers, levels, strict=True):
        logger.setLevel(level)


def wishes(verbose: int = 4, middleware: str = "ced", refs: Path | None = None) -> ServingOptions:
    return ServingOptions(verbose, middleware, refs, 30.0)


def test_profiles_are_read(tmp_path: Path) -> None:
    path = tmp_path / "refs.xml"
    path.write_text(PROFILES)
    assert read_references(path).get(ObjectKind.PARTICIPANT, "default") is not None


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (None, "cannot read the profiles in .*refs.xml: No such file"),
        (b"\xff\xfe", "is not UTF-8 text"),
        (b"<profiles>", "refs.xml: "),
        (b"<profiles><participant/></profiles>", "line 1: <participant> needs a profile_name"),
    ],
)
def test_profiles_that_cannot_be_used_are_explained(tmp_path: Path, content: bytes | None, words: str) -> None:
    path = tmp_path / "refs.xml"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(ConfigError, match=words):
        serving.serve(UdpServerLink("127.0.0.1", 0), wishes(refs=path))


class Brief(FakeLink):
    """A link that opens and ends."""

    async def run(self) -> None:
        self.signal(Signal.LINK_UP, None, "opened /dev/pts/7")
        self.signal(Signal.LINK_UP, None, "opened once more")
        await asyncio.sleep(0)
        if self.tap is not None:
            self.tap(0.0, "in", "client", b"\x80\0\0\0")


@pytest.mark.parametrize(
    ("verbose", "lines"),
    [
        (0, []),
        (3, []),
        (4, ["agent on pty:, opened /dev/pts/7, a hint; Ctrl-C ends it"]),
        (6, ["agent on pty:, opened /dev/pts/7, a hint; Ctrl-C ends it", "from peer client: 4 bytes"]),
    ],
)
def test_how_much_is_said(verbose: int, lines: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    serving.serve(Brief("pty:"), wishes(verbose), hint="a hint")
    said = capsys.readouterr().out.splitlines()
    assert len(said) >= len(lines)
    for line, words in zip(said, lines, strict=False):
        assert words in line
    if verbose < 4:
        assert said == []


def test_another_middleware_is_answered_in_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    serving.serve(Brief("pty:"), wishes(middleware="dds"))
    assert capsys.readouterr().out.splitlines()[1] == (
        "-m dds: samples stay in this process' memory; --space dds puts them into DDS"
    )


def test_a_link_that_cannot_be_opened_is_the_only_error() -> None:
    link = FakeLink()
    link.failure = LinkDown("no such port")

    async def fail() -> None:
        raise LinkDown("no such port")

    link.run = fail  # type: ignore[method-assign]  # opens nothing at all
    with pytest.raises(LinkDown, match="no such port"):
        serving.serve(link, wishes(0))


def test_tcp_may_have_a_file_for_every_connection(monkeypatch: pytest.MonkeyPatch) -> None:
    resource = pytest.importorskip("resource", reason="limits are those of Unix")
    limits: list[tuple[int, int]] = []
    monkeypatch.setattr(resource, "setrlimit", lambda which, both: limits.append(both))
    for soft, hard, wanted in (
        (256, 4096, [(1088, 4096)]),
        (256, 512, [(512, 512)]),
        (256, resource.RLIM_INFINITY, [(1088, resource.RLIM_INFINITY)]),
        (4096, 4096, []),
        (resource.RLIM_INFINITY, resource.RLIM_INFINITY, []),
    ):
        monkeypatch.setattr(resource, "getrlimit", lambda which, both=(soft, hard): both)
        limits.clear()
        serving._allow_connections()
        assert limits == wanted
