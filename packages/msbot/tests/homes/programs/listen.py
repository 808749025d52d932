"""A part that listens."""

from msbot import HelloWorld, Part

part = Part("TEST-1")


@part.on("in", HelloWorld)
def hear(message):
    print(
        message if message.index < 2 else message.message,
        message == HelloWorld(index=message.index, message=message.message),
    )
    print(f"{message.index:03d}", len(message.message), flush=True)


part.run()
