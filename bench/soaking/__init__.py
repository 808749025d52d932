"""What `bench/soak.py` and `bench/matrix.py` are made of: a robot in processes, what goes wrong, and the oracle."""
