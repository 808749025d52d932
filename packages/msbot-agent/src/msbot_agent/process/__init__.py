"""The process and its system: event loop, signals, streams, folders of the user."""
