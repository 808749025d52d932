"""What the exit status of a command says; the page of commands has the same table."""

from __future__ import annotations

from enum import IntEnum


class ExitStatus(IntEnum):
    """How a command ended. No command ends in another way, but `board shell`, whose prompt has a status of its own."""

    DONE = 0
    """It is done, or what runs until it is ended was ended: by Ctrl-C, SIGTERM or a closed terminal."""
    NO = 1
    """The answer is no (`NO_MEANS`), or the person declined a question, or its reader is gone (`| head`)."""
    MISTAKE = 2
    """A mistake in an option, file, name or address, told on standard error, or nothing was reached."""
    INTERRUPTED = 130
    """Ctrl-C broke it off before it was done, as shells count it: 128 and the number of SIGINT."""


MEANINGS = {
    ExitStatus.DONE: "done, or ended by Ctrl-C, SIGTERM or SIGHUP (a closed terminal; `nohup` prevents that)",
    ExitStatus.NO: "no, a question was declined, or nobody reads on (`| head`)",
    ExitStatus.MISTAKE: (
        "a mistake, reported on standard error; nothing was changed. For `stop` and `class stop` also: a robot or part "
        "was not reached; all others are stopped"
    ),
    ExitStatus.INTERRUPTED: "broken off by Ctrl-C",
}
"""Each for people, in Markdown."""

NO_MEANS = {
    "diff": "`apply` would change something",
    "doctor": "there is something to repair",
    "db check": "there is something to repair",
    "hardware scan": "a bus cannot be scanned",
    "service status": "the service does not run",
    "quiz": "an answer is wrong",
    "bus selftest": "a check failed",
    "board run": "the program failed",
    "topic echo": "no message came in time",
    "log diff": "the recordings differ",
    **dict.fromkeys(
        ("log show", "log filter", "log export", "play", "plot", "mission report"),
        "the recording is damaged, or has no such topic or slot",
    ),
    "extensions": "one is left out, or does not work",
}
"""Command -> what it means by `ExitStatus.NO`."""
