"""The client over a bare socket runs as it stands, and its page shows it word for word."""

from __future__ import annotations

import asyncio
import sys

from msbot_agent.agent import Agent
from msbot_agent.link import Signal
from msbot_agent.link.net import UdpServerLink
from msbot_agent.space import MemorySpace
from tests import ROOT

EXAMPLE = ROOT / "examples/core/udp_client.py"
PATIENCE_S = 60


async def test_the_client_hears_through_a_real_agent_what_it_has_said() -> None:
    link = UdpServerLink("127.0.0.1", 0)
    up = asyncio.Event()
    agent = Agent(MemorySpace(), signal=lambda _link, signal, *_: up.set() if signal is Signal.LINK_UP else None)
    agent.add_link(link)
    serving = asyncio.create_task(agent.run())
    async with asyncio.timeout(PATIENCE_S):
        await up.wait()
        client = await asyncio.create_subprocess_exec(
            sys.executable, str(EXAMPLE), "127.0.0.1", str(link.port), stdout=asyncio.subprocess.PIPE
        )
        said, _ = await client.communicate()
    serving.cancel()
    await asyncio.gather(serving, return_exceptions=True)
    assert (said.decode(), client.returncode) == ("hello from the core\n", 0)


def test_the_page_shows_the_example_as_it_is_but_for_its_imports() -> None:
    start = EXAMPLE.read_text().index("session = ")
    assert EXAMPLE.read_text()[start:] in (ROOT / "docs/howto/sans_io_core.md").read_text()
