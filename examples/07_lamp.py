from msbot import Message, Part, float32

part = Part("LAMP-1")  # a kind of your own: docs/tutorial/first_part.md shows its library file


class Dim(Message):
    percent: float32


@part.on("dim", Dim)
def shine(dim):
    print(f"the lamp shines at {min(dim.percent, part.setting('most', float, 100.0)):.0f} %", flush=True)


part.run()
