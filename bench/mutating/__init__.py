"""What `bench/mutants.py` is made of."""
