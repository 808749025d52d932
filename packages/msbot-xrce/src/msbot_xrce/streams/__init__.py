"""Streams: numbering, windows, acknowledgements, fragments (XRCE 1.0 §8.4.10 to §8.4.14)."""
