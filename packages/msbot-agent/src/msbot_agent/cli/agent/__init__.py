"""`msbot agent` and `msbot clients`: the DDS-XRCE agent for any client."""
