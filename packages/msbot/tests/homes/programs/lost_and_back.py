"""The master goes and comes; the part joins again by itself."""

from msbot import Count, Part

part = Part("TEST-1")
count = 0


@part.on_join
def joined():
    global count
    count = 0
    print("joined", part.slot)


@part.on_lost
def lost():
    print("lost", part.state.value)


@part.every(1.0)
def tick():
    global count
    count += 1
    if count <= 2:
        print("tick", count, part.publish("out", Count(value=count)))


part.run()
