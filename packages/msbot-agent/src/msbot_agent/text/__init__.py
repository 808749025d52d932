"""Texts: output, translatable sentences, JSON, files of others."""
