"""The errors of this package, and how messages reach a person."""

_print = print
_listener = None


def say(kind, text):
    """Tell a person what happens ("info") or what is wrong ("error")."""
    if _listener is not None:
        _listener(kind, text)
    else:
        _print("# " + text if kind == "info" else text)


def listen(listener):
    """Send messages to `listener(kind, text)` instead of the screen; None = the screen again."""
    global _listener  # noqa: PLW0603 - one per board
    _listener = listener


class MsbotError(Exception):
    """Base of all errors here."""


class ConfigError(MsbotError):
    """The program, its robot or `msbot.json` says something that cannot be; the text says what would be right."""


class LocalProtocolError(MsbotError):
    """This side asked for something that is not possible now, or that cannot be represented on the wire."""


class CallError(MsbotError):
    """A call has no reply, or a function refuses its request; the text says why."""


class RemoteProtocolError(MsbotError):
    """What came in makes no sense."""
