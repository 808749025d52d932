"""A part that switches pin 3 of a GPIO board, and switches it off when its master is gone."""

from msbot import HelloWorld, Part, PinDirection, SimGpio

part = Part("EFGH", robot="MSBOT_MASTER", board=SimGpio())
part.board.set_direction(3, PinDirection.OUTPUT)
part.safe_state(lambda: part.board.clear(3))


@part.on("in", HelloWorld)
def switch(message):
    part.board.set(3) if message.message.endswith("3") else part.board.clear(3)


part.run()
