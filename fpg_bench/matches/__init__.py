"""Rounds and matches that are played from here: the one loop, a match in a file, watching a pairing."""
