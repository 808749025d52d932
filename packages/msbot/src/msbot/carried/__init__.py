"""Files of the distributions that are not Python, and what is made of them."""
