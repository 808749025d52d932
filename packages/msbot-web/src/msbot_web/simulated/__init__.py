"""What the page needs from simulated parts that run in its own process."""
