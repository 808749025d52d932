"""A process that looks for garbage seldom still frees what lived for long: the objects of pages that were closed."""

from __future__ import annotations

import subprocess
import sys

PAGES = """
import weakref
from collections import deque
from msbot_agent.process.end_signals import collect_seldom

class Element:
    def __init__(self, page):
        self.page, self.children = page, [self]
        alive.add(self)

alive, most = weakref.WeakSet(), 0
collect_seldom()
opened = deque(maxlen=3)
for number in range(100):
    page = []
    page += [Element(page) for _ in range(4000)]  # some objects each: the young generation is searched meanwhile
    opened.append(page)
    most = max(most, len(alive))
print(most)
"""


def test_closed_pages_are_freed_before_they_are_many() -> None:
    done = subprocess.run([sys.executable, "-c", PAGES], capture_output=True, text=True, check=True)
    assert 12_000 <= int(done.stdout) <= 60_000
