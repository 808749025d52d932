"""Drawings as SVG: values in, a picture out."""
