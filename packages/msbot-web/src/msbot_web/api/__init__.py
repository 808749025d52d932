"""The JSON API: the twin of every page, under `/api`."""
