"""`msbot bus`: tools for people who look at a CAN bus."""
