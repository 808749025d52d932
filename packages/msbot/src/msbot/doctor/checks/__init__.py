"""The judgement: facts in, findings out. Pure."""
