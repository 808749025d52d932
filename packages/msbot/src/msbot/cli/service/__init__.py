"""`msbot service`: a robot that starts with the computer."""
