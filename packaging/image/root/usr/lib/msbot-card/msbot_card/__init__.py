"""The card's helper: what only root may do on a Raspberry Pi with MsBOT. Nothing but Python's own library."""
