"""A part without a key."""

from msbot import Part

part = Part("TEST-1", uid=bytes(range(8)))


@part.on_join
def joined():
    print("joined", part.slot)


part.run()
