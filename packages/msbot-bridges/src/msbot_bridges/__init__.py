"""Bridges: devices that speak the protocol of another world become parts of a robot like any other.

A *world* is one protocol with its library; entry points in the group `msbot.bridges` name them (`bridge.WorldKind`).
`Bridge` runs one world: for each device that the world finds it runs a `Part`, described by what the device declares.
"""
