"""What the page needs of simulated parts that run in its own process."""
