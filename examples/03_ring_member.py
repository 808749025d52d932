"""A part that does both: CC's role. It passes on what it hears."""

from msbot import HelloWorld, Part

part = Part("WXYZ", robot="MSBOT_MASTER")


@part.on("in", HelloWorld)
def pass_on(message):
    part.publish("out", HelloWorld(index=message.index, message=f"CC heard: {message.message}"))


part.run()
