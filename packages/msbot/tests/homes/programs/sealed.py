"""In a robot with sealed samples a part hears, speaks and obeys as ever."""

from msbot import HelloWorld, Part

part = Part("TEST-1", uid=bytes(range(8)), key="0011-2233-4455-6677-8899-aabb-ccdd-eeff")


@part.on_join
def joined():
    print("joined", part.slot)


@part.on("in", HelloWorld)
def heard(hello):
    print("heard", hello.index, hello.message)
    part.publish("out", HelloWorld(index=hello.index + 1, message=hello.message))


@part.on_stop
def stopped():
    print("stopped")


@part.on_go
def go():
    print("go, samples refused:", part.counters.refused)


part.run()
