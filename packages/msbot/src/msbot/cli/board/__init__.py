"""The commands for boards with MicroPython at a serial port of this computer."""
