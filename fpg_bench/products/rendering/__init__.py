"""Rendering of rounds: recordings, pictures, windows, films and interactive replays."""
