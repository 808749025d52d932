"""The DDS-XRCE client of a part: connects to any agent and stays connected."""
