"""Texts: what is printed, sentences that can be translated, JSON and files of others."""
