"""The errors of this package, and how a person is told what happens."""

_print = print
_listener = None


def say(kind, text):
    """Tell a person what happens ("info") or what is wrong ("error")."""
    if _listener is not None:
        _listener(kind, text)
    else:
        _print("# " + text if kind == "info" else text)


def listen(listener):
    """Have `listener(kind, text)` told instead of the screen; None = the screen again."""
    global _listener  # noqa: PLW0603 - one per board
    _listener = listener


class MsbotError(Exception):
    """Base of all of them."""


class ConfigError(MsbotError):
    """The program, its robot or `msbot.json` says something that cannot be; the text says what would be right."""


class LocalProtocolError(MsbotError):
    """This side asked for something that cannot be now, or that has no form on the wire."""


class RemoteProtocolError(MsbotError):
    """What came in makes no sense."""
