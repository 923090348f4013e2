"""A product of another distribution, on the public floor alone: a player, an algorithm, a game, a verb."""
