"""DroneCAN (UAVCAN v0): servos, motor controllers, range finders and batteries as parts"""
