"""The image of an SD card with MsBOT for the Raspberry Pi: how it is made, and how it is tried."""
