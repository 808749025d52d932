"""`msbot demo`: a simulated robot in the terminal."""
