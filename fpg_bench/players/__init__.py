"""Who can play: anything with Stable-Baselines3's ``predict``; scripted players, oracles and agents."""
