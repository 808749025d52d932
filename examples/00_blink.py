from msbot import Part, Switch

part = Part("BLINK-1", describes="A light that blinks")
part.publishes("light", Switch)
on = False


@part.every("period_s", default=0.5)
def blink():
    global on
    on = not on
    part.publish("light", Switch(on=on))


part.run()
