"""The commands of robots, parts and masters."""
