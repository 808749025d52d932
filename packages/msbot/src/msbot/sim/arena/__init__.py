"""A flat world for simulated robots: they drive in it, push things, and their sensors see it.

`world` says what a world is made of, `world_reader` reads one from a file, `arena` lets time pass in it. All of it is
pure: no clock, no task, the same seed gives the same run.
"""
