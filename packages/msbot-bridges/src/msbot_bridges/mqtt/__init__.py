"""MQTT: devices of Home Assistant's discovery and of Homie 4 and 5 as parts"""
