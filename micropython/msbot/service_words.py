"""Sentences about calls and services, imported only when needed."""

from .errors import say
from .message import type_name_of

_STATUS = (
    "",
    "STOP is in force: call again after GO",
    "the part that serves it has 8 requests already: call again later",
    "the function that serves it failed",
    "the part that serves it cannot read the request",
    "the program of the part has no function for it: write @part.serves(...)",
    "refused",
    "the robot does not pass it on",
)
_DOES = ("publishes", "subscribes", "serves", "calls")
_USE = ("part.publish", "@part.on", "@part.serves", "part.call")
_SENTENCE = 180


def refusal(octets):
    """Why a reply has no message."""
    if not octets:
        return "a reply without its first byte"
    if octets[0] >= len(_STATUS):
        return "a reply with status {}, which this version does not know".format(octets[0])
    said = _text(octets[1 : 1 + _SENTENCE])
    return "{}: {}".format(_STATUS[octets[0]], said) if said else _STATUS[octets[0]]


def _text(octets):
    for cut in range(4):  # the last letter may have lost some of its octets
        try:
            text = str(octets[: len(octets) - cut], "utf-8")
        except ValueError:
            continue
        return "".join([letter for letter in text if letter >= " " and letter != "\x7f"])
    return ""


def too_late(seconds):
    """Why a call has ended without a reply."""
    words = "no reply within {:g} s: is the part there that serves it (`msbot parts`), "
    return words.format(seconds) + "and does its function return in that time?"


def wrong_call(port, request, exchange, timeout, on_reply):
    """What a program does wrong that calls."""
    if exchange is None:
        words = "part.call({!r}, ...): say at the top of the program what goes and what comes: "
        return (words + "part.calls({!r}, Request, Reply)").format(port, port)
    if type(request) is not exchange[0]:
        given = request.__name__ if isinstance(request, type) else type(request).__name__
        return "port {!r} sends {}(...), not {}".format(port, exchange[0].__name__, given)
    if not callable(on_reply):
        if on_reply is not None:
            return "a handler must be a function, not {!r}".format(on_reply)
        words = "part.call({!r}, ...) cannot wait for the reply on boards and in browsers: give it on_reply=..., "
        return words.format(port) + "a function of two arguments, reply and error"
    words = "part.call({!r}, ..., timeout={!r}): the timeout is a number of seconds over 0 and up to 3600"
    return words.format(port, timeout)


def no_call(part, port, bound, fault, most):
    """Why a call is not made now."""
    if bound is None:
        words = "call of {}: this robot does not use the port: join it in a [[binding]] whose `to` names it; {}"
        return words.format(port, part._bound_words())
    if fault:
        return "call of {}: the port {}".format(port, fault)
    return "call of {}: {} calls wait for replies already: call more slowly".format(port, most)


def tell_uncalled(part, port, declared):
    """Say once what is missing at a port that serves and has no wire."""
    if (port, "wire") not in part._reported:
        part._reported.add((port, "wire"))
        words = "port {0!r}: nobody can call it before `msbot bind {0} --type '{3} -> {4}' --from {1}.{0}`; {2}"
        types = [type_name_of(one) for one in declared[:2]]
        say("info", words.format(port, part.slot, part._bound_words(), *types))


def fault(binding, direction, name):
    """Why a port that serves or calls will do neither."""
    if binding[3] != direction:
        return "{} in this robot's library: use {}, or another port".format(_DOES[binding[3]], _USE[binding[3]])
    return "carries {}, but the program says {}".format(binding[2], name)
