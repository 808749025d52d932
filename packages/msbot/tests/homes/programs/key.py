"""A part proves its UID with its key."""

from msbot import Part

part = Part("TEST-1", uid=bytes(range(8)), key="0011-2233-4455-6677-8899-aabb-ccdd-eeff")


@part.on_join
def joined():
    print("joined", part.slot)


part.run()
