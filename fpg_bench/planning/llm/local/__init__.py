"""A small language model on this machine: its file, and the server that answers from it."""
