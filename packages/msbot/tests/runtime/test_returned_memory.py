"""What a flood of connections needed for its buffers goes back to the system when they are closed."""

from __future__ import annotations

import platform
import subprocess
import sys

import pytest

FLOOD = """
import os
from msbot_agent.process.end_signals import give_memory_back

def size_mb():
    return int(open("/proc/self/statm").read().split()[1]) * os.sysconf("SC_PAGE_SIZE") // 1_000_000

if {gives_back}:
    give_memory_back()
del [bytearray(256 * 1024) for _ in range(2)][:]  # the first connections come and go
before = size_mb()
kept = []
for _ in range(300):  # each connection leaves something small behind, a session for example
    buffers = [bytearray(256 * 1024) for _ in range(2)]
    kept.append((buffers, [bytes(900) for _ in range(20)]))
most = size_mb()
kept = [small for _, small in kept]
del buffers
print(most - before, size_mb() - before)
"""


@pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="other C libraries have no such bound")
def test_large_buffers_go_back_to_the_system_although_small_pieces_between_them_are_kept() -> None:
    run = subprocess.run(
        [sys.executable, "-c", FLOOD.format(gives_back=True)], capture_output=True, text=True, check=True
    )
    most, left = map(int, run.stdout.split())
    assert most > 100
    assert left < 30


SEARCHES = """
import asyncio, gc
from msbot_agent.process.end_signals import run_to_end

async def main():
    kept = gc.get_freeze_count()
    before = gc.get_stats()[0]["collections"]
    young = [[] for _ in range(3000)]
    alike = []
    alike.append(alike)
    del alike
    print(kept > 1000, gc.get_stats()[0]["collections"] - before)
    older = [[] for _ in range(20_000)]
    print(gc.get_stats()[0]["collections"] > before)

run_to_end(main())
"""


def test_a_process_with_a_loop_searches_for_garbage_seldom_and_not_in_what_it_began_with() -> None:
    run = subprocess.run([sys.executable, "-c", SEARCHES], capture_output=True, text=True, check=True)
    assert run.stdout.split() == ["True", "0", "True"]
