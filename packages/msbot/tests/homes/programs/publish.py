"""A part that speaks."""

from msbot import HelloWorld, JoinState, Part

part = Part("TEST-1", robot="CLASSROOM")
count = 0


@part.on_join
def hello():
    print("joined", part.slot, part.state is JoinState.ACTIVE, part.reason)


@part.every(0.5)
def speak():
    global count
    count += 1
    sent = part.publish("out", HelloWorld(index=count, message="number {}".format(count)))
    print("sent", count, sent)


part.run()
