"""`make release`: all that a release consists of, made and tried here. Nothing is uploaded or tagged."""
