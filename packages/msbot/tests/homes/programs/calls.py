"""Asks its partner, and says how each call ends."""

from msbot import CallError, LocalProtocolError, Number, Part, Text

part = Part("TEST-1")
part.calls("name", Number, Text)
part.calls("spare", Number, Number)
lost_calls = []


def told(reply, error):
    if "not active any more" not in error:
        print(error or reply)
    elif not lost_calls:
        lost_calls.append(error)
        print(error.partition(" (")[0])


def ask(port, value, timeout=1.5):
    try:
        part.call(port, Number(value=value), timeout=timeout, on_reply=told)
    except CallError as error:
        print("not sent:", error)


@part.every(2.0)
def often():
    ask("name", 2.5, 5.0)


@part.on_partner_lost
def lost(port):
    print("lost", port)


@part.on_join
def joined():
    ask("spare", 1.0)
    ask("name", 1.0)
    part.after(3.0, once)


def once():
    ask("name", -1.0)
    for _ in range(16):
        ask("name", 3.0)


@part.on_stop
def stopped():
    ask("name", 4.0)


@part.on_lost
def gone():
    try:
        part.call("name", Number(), on_reply=told)
    except LocalProtocolError as error:
        print("not active" in str(error))


try:
    part.calls("name", Number, Number)
except Exception as error:
    print(error)
part.run()
