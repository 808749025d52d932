"""Recordings: reading them, whoever wrote them; cutting, comparing and exporting them."""
