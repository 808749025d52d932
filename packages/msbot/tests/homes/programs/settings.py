"""Settings that change while the part runs."""

from msbot import Count, Part

part = Part("TEST-1")


@part.on_setting("gain", float)
def gain(value):
    print("gain", value)


@part.on_setting("on", bool)
def on(value):
    print("on", value)


@part.on_join
def joined():
    print("joined", sorted(part.settings.items()), part.setting("label"), part.setting("step", int, 7))


@part.every("period_s")
def tick():
    part.publish("out", Count(value=part.setting("step", int, 7)))


part.run()
