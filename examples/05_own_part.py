from msbot import Message, Part, float32

part = Part("LUX-1", local_name="left eye")  # a kind of your own: docs/howto/add_a_part_type.md shows its library file


class Light(Message):
    lux: float32


@part.every(0.5)
def measure():
    part.publish("light", Light(lux=42.0 * part.setting("gain", float, 1.0)))


part.run()
