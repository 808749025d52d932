"""Functions that wait (`yield 1.0`), by the rules of `msbot.part.waiting`; imported when a program has one."""

from micropython import const

from .errors import LocalProtocolError

_LEAST = const(10)  # ms; a loop that yields 0 leaves time for the rest of the part
_MOST = const(64)


class Waiting:
    """A function that has begun and has not ended."""

    def __init__(self, function, steps):
        self.function = function
        self.steps = steps
        self.due_at = 0  # ms
        self.running = self.held = self.over = False


class WaitingFunctions:
    """The functions of one part that wait."""

    def __init__(self):
        self.all = []

    def begin(self, function, steps, now):
        """Do the first step of a function, unless it is waiting already; raises what the function raises."""
        for one in self.all:
            if one.function == function:
                return
        if len(self.all) >= _MOST:
            raise LocalProtocolError("{} functions wait already".format(_MOST))
        self.all.append(Waiting(function, steps))
        self.go_on(self.all[-1], now)

    def go_on(self, one, now):
        """Do its next step, and wait as long as it says; raises what the function raises."""
        one.running = True
        wait = None
        try:
            wait = next(one.steps)
            if not _is_time(wait):
                words = "yield waits for seconds, a number from 0 up: yield 0.5, not yield {!r}".format(wait)
                wait = one.steps.throw(ValueError(words))
        except StopIteration:
            wait = None
        finally:
            one.running = False
            if one.over or not _is_time(wait):
                self.end(one)
            else:
                one.due_at = now + max(_LEAST, int(wait * 1000 + 0.5))

    def due(self, now):
        """Those whose time has come."""
        return [one for one in self.all if now >= one.due_at and not one.held]

    def times(self):
        """When they are due."""
        return [one.due_at for one in self.all if not one.held]

    def hold(self, held):
        """STOP: those that wait stay where they are. GO: they go on."""
        for one in self.all:
            one.held = held

    def end_of(self, function):
        """End a function, if it waits: it is about to begin anew."""
        for one in list(self.all):
            if one.function == function:
                self.end(one)

    def end_all(self):
        """End all."""
        for one in list(self.all):
            self.end(one)

    def end(self, one):
        """End one."""
        one.over = True
        if one in self.all:
            self.all.remove(one)
        if not one.running:
            one.steps.close()


def _is_time(seconds):
    return isinstance(seconds, (int, float)) and not isinstance(seconds, bool) and 0 <= seconds < float("inf")
