"""Ends when the first of its calls has come to nothing: the others end as well, each once."""

from msbot import Number, Part, Text

part = Part("TEST-1")
part.calls("name", Number, Text)
ends = []


def told(reply, error):
    ends.append(error)
    print("end number", len(ends), error.partition(" (")[0].partition("?")[0])
    part.end()


@part.on_join
def ask():
    for _ in range(3):
        part.call("name", Number(value=1.0), on_reply=told)


part.run()
