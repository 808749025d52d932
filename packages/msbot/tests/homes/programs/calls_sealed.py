"""Asks its partner in a robot whose samples are sealed."""

from msbot import Number, Part, Text

part = Part("TEST-1", uid=bytes(range(8)), key="00112233445566778899aabbccddeeff")
part.calls("name", Number, Text)


@part.every(0.4)
def ask():
    part.call("name", Number(value=7.0), on_reply=lambda reply, error: print(error or reply.text))


part.run()
