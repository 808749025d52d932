"""DroneCAN (UAVCAN v0): servos, motor controllers, range finders, batteries and GNSS receivers as parts"""
