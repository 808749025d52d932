"""The commands that run until they are ended: a master, a part; and the page beside them."""
