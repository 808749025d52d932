"""A part has the wrong key, and is told so."""

from msbot import Part

part = Part("TEST-1", uid=bytes(range(8)), key="ffff-2233-4455-6677-8899-aabb-ccdd-eeff")


@part.on_join
def joined():
    print("joined", part.slot)


part.run()
