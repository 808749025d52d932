"""Modbus RTU and TCP: registers that a table names as the ports of parts"""
