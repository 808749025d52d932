"""Cyphal (UAVCAN v1): sensors, servos and batteries as parts"""
