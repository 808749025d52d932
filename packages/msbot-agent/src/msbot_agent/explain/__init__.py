"""From meaning to bits: captures and questions for `msbot explain` and `msbot quiz`."""
