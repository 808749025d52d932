"""Sentences for people, imported only when needed: memory on a board is scarce."""

import io
import struct
import sys

from .errors import ConfigError, say
from .message import Kind, Message, fits, limits, type_name_of

_SHOWN = 60
_FLOATS = {"f": "float32", "d": "float64"}

REFUSALS = (
    "this part number is not in the library",
    "this part is blocked",
    "another part with the same UID is active",
    "every fitting slot is taken, or it is not clear which one is meant",
    "this robot has no slot for this part number",
    "the claim makes no sense",
    "the inventory cannot read its registry",
    "the part's key is not the one on file for its UID",
    "this robot asks for keys, and the part proves none",
    "this robot asks for keys, and has none for this part",
    "an old proof was shown again, or one that nobody asked for",
)
_NO_SLOT = 4
_KEY_NEEDED = 9


def refusal(reason):
    """Why a claim was refused."""
    if not 0 < reason <= len(REFUSALS):
        return "refused for reason {}".format(reason)
    return REFUSALS[reason - 1]


def told_state(state, reason, describes):
    """How the state of a refused part is told, without a free slot it is a spare that waits; and what helps."""
    hint = '; with Part(..., describes="what it is") somebody can adopt it'
    is_unknown = reason == REFUSALS[0] and not describes
    return "standby" if reason == REFUSALS[_NO_SLOT - 1] else state, hint if is_unknown else ""


def tell_described():
    """Say that the robot is told what the part is."""
    words = (
        "the robot does not know this part number, and is told what the part is: it waits until somebody adopts it, on "
        "the page Arrivals or with `msbot adopt`"
    )
    say("info", words)


def tell_help(settings):
    """Say what the robot says to a part that it does not let in."""
    for name, text in settings:
        if name == ".why":
            say("info", "the robot says: " + text)


def no_size(kind):
    """The error of a type of Python that has no form on the wire."""
    more = "int32 (or int8, int16, int64, uint8 to uint64)" if kind is int else "float32 (or float64)"
    return ConfigError("{} says no size on the wire: write {}".format(kind.__name__, more))


def key_needed():
    """Why a part without a key gets no further."""
    return REFUSALS[_KEY_NEEDED - 1] + ": give it its key in msbot.json"


def bound(ports):
    """The bound ports of a part."""
    if not ports:
        return "this robot binds no port of the part"
    listed = ["{} ({} {})".format(p[0], ("publish", "subscribe", "serve", "call")[p[3]], p[2]) for p in ports]
    return "bound in this robot: " + ", ".join(listed)


def not_active(part, verb="publish"):
    """Why a part cannot do that now."""
    if part._client is None:
        return "the part does not run: {} in a function below @part.every or @part.on".format(verb)
    return "the part is {}, not active ({}): {} after on_join".format(part.state.value, part.reason, verb)


def too_many_delayed(most):
    """Why no more functions can wait."""
    return "{} functions wait for their time already: does `after` call itself more than once?".format(most)


def cannot_start(function):
    """Why a function cannot be started now."""
    words = "the part does not run: start {} in a function below @part.every or @part.on"
    return words.format(getattr(function, "__name__", function))


def not_for_port(part, port, binding, message):
    """Why a message cannot be published at a port."""
    kind = type(message)
    if binding[3]:
        return "there is no port {!r} to publish on; {}".format(port, part._bound_words())
    if not isinstance(message, Message):
        if kind is type:
            return "port {!r} publishes messages, not the type {n}: write {n}(...)".format(port, n=message.__name__)
        return "port {!r} publishes messages, not {}".format(port, kind.__name__)
    return "port {!r} carries {}, not {}".format(port, binding[2], type_name_of(kind))


def identify(part):
    """Say that somebody wants to see which part it is."""
    say("info", "{}: somebody asks which part this is".format(part.local_name))


def partner(part, port):
    """Say that a port has lost its partner."""
    calls = part.services and port in part.services._calls
    what = "serves what port {} calls" if calls else "sends to port {}"
    say("info", "{}: nobody {} any more".format(part.local_name, what.format(port)))


def unreadable(part, port, error):
    """Report a message that makes no sense."""
    part.report("port {!r}".format(port), "a message that cannot be read: {}".format(error), "unreadable")


def no_setting(part, name):
    """What is wrong with asking for a setting."""
    known = ", ".join(sorted(part.settings)) or "none"
    return "there is no setting {!r} in this robot; it sets: {}".format(name, known)


def no_value(name, text, kind):
    """What is wrong with a setting's text."""
    wanted = {bool: "true or false", int: "a whole number", float: "a number", str: "text"}[kind]
    return "setting {!r} is {!r}, which is not {}".format(name, text, wanted)


def misfit(message, field, kind, value):
    """Why a field of a message cannot hold a value, or the first element of a list that does not fit."""
    while hasattr(kind, "element") and isinstance(value, list):
        places = [place for place, one in enumerate(value) if not fits(kind.element, one)]
        if kind.octets or not places:
            break
        kind, value, field = kind.element, value[places[0]], "{}[{}]".format(field, places[0])
    wrong = kind.wrong_size(value) if hasattr(kind, "wrong_size") else ""
    if wrong:
        return "{}.{} {}".format(message, field, wrong)
    shown = repr(value)
    shown = shown if len(shown) <= _SHOWN else shown[:_SHOWN] + "..."
    return "{}.{} cannot be {}: {}".format(message, field, shown, _needs(kind))


def _needs(kind):
    if kind is str:
        return "str needs a text without NUL characters"
    if isinstance(kind, Kind):
        return kind.needs()
    if not isinstance(kind, str):
        return {bool: "bool needs True or False", bytes: "bytes needs bytes"}.get(kind) or "needs a " + kind.__name__
    if kind in _FLOATS:
        return _FLOATS[kind] + " needs a number"
    low, high = limits(kind)
    word = "{}int{}".format("" if low else "u", 8 * struct.calcsize(kind))
    return "{} needs a whole number from {} to {}".format(word, low, high)


def failed(part, function, error):
    """Say that a function has ended with an error; a mistake of the program ends the part."""
    where = place(error) or function.__name__
    if not isinstance(error, ConfigError):
        kind = type(error).__name__
        part.report(where, "{}: {} (said once, counted from now on)".format(kind, error), kind)
    elif part.configurations > 1:  # it worked with an earlier one: the program is not to blame
        part.report("{}: {}".format(where, error), "since the configuration has changed")
    else:
        part._reported.add("mistake")
        part.end()
        say("error", "{}: {}".format(where, error))


class ProgramFailed(Exception):
    """A mistake, which a sentence has told, has ended the program."""


def ended(part):
    """The part has ended; so does its program, if `failed` has told a mistake of it."""
    if "mistake" in part._reported:
        _end()


def fail(what):
    """End the program after a mistake: an error, or the name of a file that is not there."""
    say("error", "there is no file {} on the board".format(what) if isinstance(what, str) else str(what))
    _end()


def _end():
    """End it on a computer with status 2, as there under CPython.

    A board would start anew at SystemExit, and so for ever; for an exception it prints where it was, and is at hand.
    """
    if sys.platform in ("linux", "darwin", "win32"):
        raise SystemExit(2)
    raise ProgramFailed("the line above says why")


def slow(took, most):
    """What is wrong with a function that took so many milliseconds."""
    return "took {:.1f} s, and the part cannot beat meanwhile: keep it below {} s".format(took / 1000, most / 1000)


def disagreement(word, theirs, mine):
    """Why a robot is not the expected one."""
    return "this robot's {} is {!r}, the part expects {!r}".format(word, theirs, mine)


def place(error):
    """The innermost line of the student's own code: `my_part.py:12 in measure`."""
    story = io.StringIO()
    sys.print_exception(error, story)
    found = None
    for line in story.getvalue().split("\n"):
        if line.startswith('  File "') and "msbot/" not in line:
            name, _, rest = line[8:].partition('", line ')
            number, _, function = rest.partition(", in ")
            found = "{}:{} in {}".format(name.split("/")[-1], number, function)
    return found
