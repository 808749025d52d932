"""Functions that are called periodically, on a grid that does not drift."""

from msbot import Part, Trigger

part = Part("TEST-1")
counts = {"quick": 0, "slow": 0}


@part.every(0.1)
def quick():
    counts["quick"] += 1


@part.every(0.77)
def slow():
    counts["slow"] += 1
    print(counts["quick"], counts["slow"])
    if counts["slow"] == 5:
        part.publish("out", Trigger(index=counts["quick"]))
        part.end()


@part.on_end
def end():
    print("end", part.state.value, part.counters.messages_out)


part.run()
