"""The blueprint of a robot: reading, checking, comparing and writing `robot.toml`."""
