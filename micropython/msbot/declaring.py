"""What a program says of its part with decorators; forgotten when the part begins, since memory on a board is scarce.

Nothing that stays may be defined here: a function keeps its whole module in memory.
"""

from .errors import ConfigError
from .message import Message
from .part import KINDS, Timed, check_function, milliseconds


def every(part, period, default):
    """See `Part.every`."""
    if not isinstance(period, str) and not period > 0:
        raise ConfigError("every({}): the period must be more than 0 seconds".format(period))

    def remember(function):
        check_function(function)
        timed = Timed(1000 if isinstance(period, str) else milliseconds(period), function)
        part._timed.append(timed)
        if isinstance(period, str):
            _declare(part, period, float, default, 0.001, None, "s")
            part._followers.append((period, float, part._pace_of(timed, period)))
        return function

    return remember


def on(part, port, message_class, optional, safe):
    """See `Part.on`."""
    if not (isinstance(message_class, type) and issubclass(message_class, Message)):
        words = "@part.on({!r}, ...) needs the class of the message, not {!r}: on({!r}, HelloWorld)"
        raise ConfigError(words.format(port, message_class, port))
    if port in part._listeners:
        raise ConfigError("port {!r} has a function already: one function per port".format(port))

    def remember(function):
        check_function(function)
        part._listeners[port] = (message_class, function, optional)
        part.declared.append(("subscribe", port, message_class, safe))
        return function

    return remember


def on_setting(part, name, kind, default, least, most, unit):
    """See `Part.on_setting`."""
    check_kind(name, kind)

    def remember(function):
        check_function(function)
        _declare(part, name, kind, default, least, most, unit)
        part._followers.append((name, kind, function))
        return function

    return remember


def _declare(part, name, kind, default, least, most, unit):
    if default is None and not part.describes:
        return
    if default is None:
        words = "setting {!r} needs a default, because the part describes itself: for example "
        words += "on_setting({!r}, float, default=1.0) or every({!r}, default=1.0)"
        raise ConfigError(words.format(name, name, name))
    default = kind(default)
    part._defaults[name] = str(default).lower() if kind is bool else str(default)
    part.declared.append(("setting", name, kind, (default, least, most, unit)))


def check_kind(name, kind):
    """Raise ConfigError if settings have no such kind."""
    if kind not in KINDS:
        raise ConfigError("setting {!r} can be read as bool, int, float or str, not as {!r}".format(name, kind))
