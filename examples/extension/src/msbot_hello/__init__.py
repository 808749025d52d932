"""An extension of MsBOT that brings one of everything."""
