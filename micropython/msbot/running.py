"""Runs a part: the main loop, and loading programs so that their annotations work."""

import sys
import time

from .errors import MsbotError

_NAP = 1  # ms between two polls of the link

_PACKAGE = __name__.rpartition(".")[0]
_host = None


def use_host(host):
    """Make `run` pass each part to `host(part)`, which begins and steps it: for browsers, which must not block."""
    global _host  # noqa: PLW0603 - one per board
    _host = host


def run(part):
    """Run the part until it ends or Ctrl-C."""
    if _host is not None:
        _host(part)
        return
    try:
        link = once("board").open_for(part)
    except MsbotError as error:
        once("words").fail(error)
    part.nature = part.nature or 1  # this is a board, so there is hardware
    clock = Clock()
    part.clock = clock.now
    part.begin(link, clock.now())
    due = 0
    while due is not None:
        try:
            while due is not None:  # inside: MicroPython may raise it where a loop begins again
                due = part.step(clock.now())
                if due is not None:
                    time.sleep_ms(max(0, min(due - clock.now(), _NAP)))
        except KeyboardInterrupt:
            part.end()
    once("words").ended(part)


def start(name):
    """Run a program file, with the fields of its message classes kept (see `message`)."""
    try:
        with open(name) as file:
            source = once("annotations").with_fields(file.read())
    except OSError:
        once("words").fail(name)
    try:
        exec(compile(source, name, "exec"), {"__name__": "__main__"})
    except MsbotError as error:
        once("words").fail(error)


class Clock:
    """Milliseconds that do not wrap."""

    def __init__(self):
        self._ticks = time.ticks_ms()
        self._now = 0

    def now(self):
        """Milliseconds since it was made."""
        ticks = time.ticks_ms()
        self._now += time.ticks_diff(ticks, self._ticks)
        self._ticks = ticks
        return self._now


def load(name):
    """Import a module when it is needed."""
    return __import__(_PACKAGE + "." + name, None, None, ("",))


def once(name):
    """Import a module that is needed only now, so that its memory is free again afterwards."""
    module = load(name)
    forget(name)
    return module


def forget(name):
    """Free the memory of a module that is not needed any more."""
    if sys.modules.pop(_PACKAGE + "." + name, None):
        delattr(sys.modules[_PACKAGE], name)
