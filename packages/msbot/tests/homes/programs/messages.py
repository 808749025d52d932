"""Standard messages, and one of its own."""

from msbot import Battery, Colour, Key, Message, Part, Place, Switch, Text, Vector, float32, int16, uint8, uint64

part = Part("TEST-1")


class Mood(Message):
    """How a part feels."""

    level: int16  # from -100 to 100
    name: str = "calm"
    happy: bool = True
    count: uint64
    raw: bytes
    warmth: float32 = 0.5


class Family(Message):
    mood: Mood
    age: uint8


@part.on_join
def show():
    for message in (Switch(on=True), Colour(red=255, blue=1), Key(key="#", pressed=True), Vector(x=0.5, y=-2.0, z=8.0)):
        print(message, message.encode().hex(), type(message).decode(message.encode()) == message)
    print(Place(latitude=47.25, satellites=9).encode().hex())
    print(Battery().encode().hex(), Text(text="grün").encode().hex())
    mood = Mood(level=-7, count=1 << 40, raw=b"\x00\xff")
    print(mood)
    print(mood.encode().hex())
    family = Family(mood=mood, age=3)
    print(Family.decode(family.encode()))
    mood.level = 9
    print(part.publish("mood", mood), Mood() == Mood(), Mood() == Mood(level=1))


@part.on("other", Mood)
def hear(message):
    print("heard", message.name, message.level, message.happy, message.warmth)


part.run()
