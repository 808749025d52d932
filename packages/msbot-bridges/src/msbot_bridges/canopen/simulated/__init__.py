"""Simulated CANopen devices, made with the library's `LocalNode`"""
