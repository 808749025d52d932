"""What a stock client gets through a network that loses and reorders.

    python -m bench.loss_and_order    the model of the client, in virtual time: the same each time
    ... bench/loss_and_order.py --client 'PROGRAM {host} {port} {direct}' [--agent 'NAME=OTHER AGENT {port}']

`--write` keeps the table: `bench/results/loss_and_order.md` of the model, `loss_and_order_genuine.md` of a client.

A client writes 200 samples, one each 10 ms, on its reliable stream over a network that loses a share of all packets in
both directions and delays another share by up to 30 ms, so that later ones overtake them. Somebody reads on a network
that does neither. PROGRAM is a genuine client: it logs in at `{host}:{port}` with what writes and at `{host}:{direct}`
with what reads, ends after 60 s at most, and prints one line of JSON with `got`, the samples that arrived. An agent is
started anew for each run. A run whose set-up failed counts as 0 samples.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import random
import shlex
import socket
import statistics
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import cast

from bench.machine import describe_machine
from bench.result import write_result
from tests.conformance.lossy_run import write_over

LOSSES = (0.0, 0.1, 0.2, 0.3)
REORDERS = (0.0, 0.1, 0.2)
SAMPLES = 200
DELAY_S = 0.03
OURS = f"{shlex.quote(sys.executable)} -m msbot agent udp4 -p {{port}}"


class Proxy(asyncio.DatagramProtocol):
    """Carries datagrams between one client and the agent, and loses and delays some."""

    def __init__(self, agent: tuple[str, int], chance: random.Random, loss: float, reorder: float) -> None:
        self._agent, self._chance, self._loss, self._reorder = agent, chance, loss, reorder
        self._client: tuple[str, int] | None = None
        self._transport: asyncio.DatagramTransport | None = None

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """The socket is open."""
        self._transport = cast("asyncio.DatagramTransport", transport)

    def datagram_received(self, data: bytes, addr: tuple[str, int]) -> None:
        """Carry one, or do not."""
        if addr != self._agent:
            self._client = addr
        to = self._client if addr == self._agent else self._agent
        if to is None or self._transport is None or self._chance.random() < self._loss:
            return
        late_s = self._chance.random() * DELAY_S if self._chance.random() < self._reorder else 0.0
        if late_s:
            asyncio.get_running_loop().call_later(late_s, self._send, data, to)
        else:
            self._send(data, to)

    def _send(self, data: bytes, to: tuple[str, int]) -> None:
        if self._transport is not None and not self._transport.is_closing():
            self._transport.sendto(data, to)


def free_port() -> int:
    """A port that nobody has at the moment."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
        return port


@contextmanager
def serving(command: str, port: int) -> Iterator[None]:
    """Run an agent; it has a second to open its socket."""
    process = subprocess.Popen(
        shlex.split(command.format(port=port)), stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    )
    try:
        for _ in range(200):
            if f":{port:04X} " in Path("/proc/net/udp").read_text(encoding="ascii"):
                break
            time.sleep(0.05)
        yield
    finally:
        process.terminate()
        process.wait()


async def run_client(client: str, port: int, loss: float, reorder: float, seed: int) -> int:
    """One run; how many samples arrived."""
    loop = asyncio.get_running_loop()
    proxy = Proxy(("127.0.0.1", port), random.Random(seed), loss, reorder)
    transport, _ = await loop.create_datagram_endpoint(lambda: proxy, local_addr=("127.0.0.1", 0))
    command = client.format(host="127.0.0.1", port=transport.get_extra_info("sockname")[1], direct=port)
    process = await asyncio.create_subprocess_exec(*shlex.split(command), stdout=asyncio.subprocess.PIPE)
    try:
        async with asyncio.timeout(90):
            output, _ = await process.communicate()
    except TimeoutError:
        process.kill()
        return 0
    finally:
        transport.close()
    lines = output.decode(errors="replace").splitlines()
    return int(json.loads(lines[-1]).get("got", 0)) if lines else 0


def cell(arguments: argparse.Namespace, agent: str | None, loss: float, reorder: float) -> list[int]:
    """The samples that arrived in each run."""
    found = []
    for seed in range(arguments.seeds):
        if agent is None:
            found.append(write_over(seed, drop=loss, reorder=reorder, samples=SAMPLES).arrived)
            continue
        port = free_port()
        with serving(agent, port):
            found.append(asyncio.run(run_client(arguments.client, port, loss, reorder, seed)))
    return found


def main() -> None:
    """Run all cells, and write the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--client", help="a genuine client, with {host}, {port} and {direct}")
    parser.add_argument(
        "--agent",
        action="append",
        default=[],
        metavar="NAME=COMMAND",
        help="another agent, with {port}; may be repeated",
    )
    parser.add_argument("--seeds", type=int, default=6)
    parser.add_argument("--note", default="", help="what client and agents these are, for the page")
    parser.add_argument("--write", action="store_true", help="keep the table in bench/results")
    arguments = parser.parse_args()
    others = [one.partition("=") for one in arguments.agent]
    agents: list[str | None] = [OURS, *(command for _, _, command in others)] if arguments.client else [None]
    names = ["`msbot agent`", *(name for name, _, _ in others)]
    who = f"a genuine client: {arguments.note}" if arguments.client else "the model of the stock client, virtual time"
    lines = [
        f"{describe_machine()}, {time.strftime('%Y-%m-%d')}; {who}.",
        "",
        f"Of {SAMPLES} samples arrived: median, least, and how many of {arguments.seeds} runs had all.",
        "",
        "| loss | reordered | " + " | ".join(names) + " |",
        "|" + "---|" * (2 + len(agents)),
    ]
    for loss in LOSSES:
        for reorder in REORDERS:
            runs = [cell(arguments, agent, loss, reorder) for agent in agents]
            texts = [f"{statistics.median(one):g}, {min(one)}, {sum(n == SAMPLES for n in one)}" for one in runs]
            lines.append(f"| {loss:.0%} | {reorder:.0%} | " + " | ".join(texts) + " |")
            print(lines[-1], flush=True)
    if not arguments.write:
        return
    if arguments.client:
        title, more = "Loss and reordering with a genuine client", " --client ... --agent ..."
        name = "loss_and_order_genuine"
    else:
        title, more, name = "Loss and reordering with the model of a client", "", "loss_and_order"
    write_result(name, title, lines, made_by=f"python -m bench.loss_and_order{more} --write")


if __name__ == "__main__":
    main()
