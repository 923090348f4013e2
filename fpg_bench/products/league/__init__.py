"""League training by algorithm: best responses, self-play, double oracles, and the champions of the zoo."""
