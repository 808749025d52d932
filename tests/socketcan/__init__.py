"""Tests on a real kernel's CAN bus, inside a virtual machine (docs/howto/kernel_bus.md)."""
