"""Telemetry of the libraries in use: off, unless the user's environment says otherwise."""

from __future__ import annotations

import os

# Read by onnxruntime and huggingface_hub when they are imported, by Ray when it is started. Otherwise
# onnxruntime starts a thread, writes an id of the device into the user's cache and sends events.
OFF = {"ORT_DISABLE_TELEMETRY": "1", "HF_HUB_DISABLE_TELEMETRY": "1", "RAY_USAGE_STATS_ENABLED": "0"}


def turn_off_telemetry() -> None:
    """Set the variables that turn telemetry off, in this process and in those that it starts."""
    for name, value in OFF.items():
        os.environ.setdefault(name, value)
