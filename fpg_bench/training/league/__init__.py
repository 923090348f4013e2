"""League training: best responses to a player, self-play against the past, champions against populations."""
