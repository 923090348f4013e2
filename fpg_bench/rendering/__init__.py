"""Pictures of rounds: recordings, what is drawn of them, windows, films and interactive replays."""
