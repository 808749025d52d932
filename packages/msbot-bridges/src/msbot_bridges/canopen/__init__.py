"""CANopen: drives (CiA 402), input and output modules (CiA 401), devices with an EDS as parts"""
