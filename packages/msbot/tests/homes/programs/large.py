"""Messages larger than a packet travel in pieces, both ways."""

from msbot import Part, Text

part = Part("TEST-1")


@part.on("in", Text)
def hear(message):
    print("heard", len(message.text), message.text == "ab" * 1000)
    print("sent", part.publish("out", Text(text="cde" * 500)))


part.run()
