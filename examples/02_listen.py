"""A part that listens: BB's role in the sample robot."""

from msbot import HelloWorld, Part

part = Part("EFGH", robot="MSBOT_MASTER")


@part.on("in", HelloWorld)
def hear(message):
    print(message.message, flush=True)


part.run()
