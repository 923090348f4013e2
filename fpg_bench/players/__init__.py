"""Players: scripts, oracles, ONNX agents, or any object with Stable-Baselines3's ``predict``."""
