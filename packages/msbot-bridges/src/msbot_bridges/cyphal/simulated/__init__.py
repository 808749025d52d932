"""Simulated Cyphal devices, nodes of the library `pycyphal`"""
