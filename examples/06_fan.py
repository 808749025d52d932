"""A fan: its setting counts at once when somebody changes it, and it stands still when nobody is in command."""

from msbot import Level, Part

part = Part("FAN-5V")


@part.on("power", Level)
def turn(level):
    starts = level.percent >= part.setting("start_at", float, 15.0)
    print(f"the fan turns at {level.percent if starts else 0:.0f} %", flush=True)


part.run()
