"""Agents from zips that Stable-Baselines3 and rl_zoo3 have written."""
