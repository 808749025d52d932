"""Files that the distributions bring and that are not Python: where they are, and what is made of them."""
