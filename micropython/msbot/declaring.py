"""What a program says of its part with decorators; forgotten when the part begins, since memory on a board is scarce.

Nothing that stays may be defined here: a function keeps its whole module in memory.
"""

from .errors import ConfigError
from .message import Message
from .part import KINDS, Timed
from .running import once

_WHEN = {
    "on_join": "join",  # whenever the part has become active
    "on_lost": "lost",  # whenever it stops being active without ending; see `reason`
    "on_end": "end",  # once when it ends
    "on_stop": "stop",  # on STOP, after every port has its safe value
    "on_go": "go",  # on GO: messages reach the part's functions again
    "on_identify": "identify",  # when somebody asks which part this is
    "safe_state": "safe",  # when nothing controls the part any more
    "on_partner_lost": "partner",  # with the name of a port whose senders have all gone
}


def check_names(part):
    """Raise ConfigError if a part's number or name cannot be told."""
    for what, text in (("part number", part.part_number), ("local name", part.local_name)):
        if not isinstance(text, str):
            raise ConfigError('the {} is a text, not {!r}: write "{}"'.format(what, text, text))
        size = len(text.encode())
        if not text or size > 254 or "\0" in text:
            raise ConfigError("the {} must have 1 to 254 bytes, not {}".format(what, size))


def verb(part, name):
    """What a part's program calls by that name."""
    if name in _WHEN:
        return lambda function: _remember(part._when.setdefault(_WHEN[name], []), function)
    if name == "board":
        words = "part {} has no board: make it with Part(..., board=SimGpio())"
        raise ConfigError(words.format(part.local_name))
    if name in ("hardware", "software", "home"):
        return once("versions").default(name)
    if name in ("serves", "calls"):
        return getattr(part.use_services(), name)
    function = {"every": every, "on": on, "on_setting": on_setting, "publishes": publishes}.get(name)
    if function is None:
        raise AttributeError("'Part' object has no attribute '{}'".format(name))
    return lambda *values, **options: function(part, *values, **options)


def every(part, period, *, default=None):
    """Call the function below every `period` seconds while the part is active; a text names a setting."""
    if not isinstance(period, str) and not period > 0:
        raise ConfigError("every({}): the period must be more than 0 seconds".format(period))

    def remember(function):
        timed = Timed(1000 if isinstance(period, str) else max(1, int(period * 1000 + 0.5)), function)
        _remember(part._timed, function, timed)
        if isinstance(period, str):
            _declare(part, period, float, default, 0.001, None, "s")
            part._followers.append((period, float, timed))
        return function

    return remember


def check_after(seconds, function):
    """Raise ConfigError if no such function can be called after such a time."""
    if not callable(function):
        raise ConfigError("a handler must be a function, not {!r}".format(function))
    raise ConfigError("after({}): the time must be 0 seconds or more".format(seconds))


def on(part, port, message_class, optional=False, safe=None, ranges=None):
    """Call the function below with each message that arrives at the port; not `*`, which takes memory."""
    if not (isinstance(message_class, type) and issubclass(message_class, Message)):
        words = "@part.on({0!r}, ...) needs the class of the message, not {1!r}: on({0!r}, HelloWorld)"
        raise ConfigError(words.format(port, message_class))
    if port in part._listeners:
        raise ConfigError("port {!r} has a function already: one function per port".format(port))

    def remember(function):
        _remember(
            part.declared, function, ("subscribe", port, message_class, safe if ranges is None else (safe, ranges))
        )
        part._listeners[port] = (message_class, function, optional)
        return function

    return remember


def publishes(part, port, message_class):
    """Declare that the part publishes such messages at that port; a part that describes itself must."""
    part.declared.append(("publish", port, message_class, None))


def on_setting(part, name, kind=str, *, default=None, least=None, most=None, unit=""):
    """Call the function below with the setting's value, before `on_join`, and whenever it changes."""
    check_kind(name, kind)

    def remember(function):
        _remember(part._followers, function, (name, kind, function))
        _declare(part, name, kind, default, least, most, unit)
        return function

    return remember


def _remember(where, function, what=None):
    if not callable(function):
        raise ConfigError("a handler must be a function, not {!r}".format(function))
    where.append(function if what is None else what)
    return function


def _declare(part, name, kind, default, least, most, unit):
    if default is None and not part.describes:
        return
    if default is None:
        words = (
            "setting {0!r} needs a default, because the part describes itself: for example "
            "on_setting({0!r}, float, default=1.0) or every({0!r}, default=1.0)"
        )
        raise ConfigError(words.format(name))
    default = kind(default)
    part._defaults[name] = str(default).lower() if kind is bool else str(default)
    part.declared.append(("setting", name, kind, (default, least, most, unit)))


def check_kind(name, kind):
    """Raise ConfigError if settings have no such kind."""
    if kind not in KINDS:
        raise ConfigError("setting {!r} can be read as bool, int, float or str, not as {!r}".format(name, kind))
