"""A part that the robot does not know proves its key, and only then says what it is; every sample is sealed."""

from msbot import Light, Part

part = Part("VANE-1", uid=bytes(range(8)), key="0011-2233-4455-6677-8899-aabb-ccdd-eeff", describes=True)
part.publishes("light", Light)


@part.on_join
def joined():
    print("joined", part.slot)


part.run()
