"""The words of the game: jamming types, paths and the variants of its rules."""

from __future__ import annotations

JAMMING_TYPES = ("tone", "narrowband", "broadband", "comb")
PATHS = ("circle", "triangle", "rectangle", "pursuit", "learned", "waypoints")
PATROLS = ("circle", "triangle", "rectangle")
SNR_MODELS = ("sinr", "paper")
MOST_PATHS = 16  # that a round may draw from
DETECTIONS = ("emission", "link", "off")
