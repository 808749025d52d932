"""The laboratory: what a robot did, kept for later (the flight recorder), looked into, and played again."""
