"""Training with Stable-Baselines3, and the export of what was trained."""
