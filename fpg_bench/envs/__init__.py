"""Environments: Gymnasium single and batched, Stable-Baselines3, PettingZoo, both sides at once."""
