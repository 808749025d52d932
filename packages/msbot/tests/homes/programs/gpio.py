"""A simulated GPIO board."""

from msbot import HelloWorld, LocalProtocolError, Part, PinDirection, SimGpio

part = Part("TEST-1", board=SimGpio())
part.board.on_change(lambda pin, level: print("pin", pin, level))
part.board.set_direction(3, PinDirection.OUTPUT)
part.safe_state(lambda: part.board.clear(3))


@part.on("in", HelloWorld)
def switch(message):
    part.board.set(3)
    part.board.drive(4, level=True)
    print(part.board.read(3), part.board.read(4), PinDirection.INPUT.value)
    try:
        part.board.set(5)
    except LocalProtocolError as error:
        print(error)


part.run()
