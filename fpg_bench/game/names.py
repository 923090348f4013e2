"""Names of jamming types, paths, variants of the rules, and of observed and chosen numbers."""

from __future__ import annotations

JAMMING_TYPES = ("tone", "narrowband", "broadband", "comb")
PATHS = ("circle", "triangle", "rectangle", "pursuit", "learned", "waypoints")
PATROLS = ("circle", "triangle", "rectangle")
SNR_MODELS = ("sinr", "paper", "link")
MOST_PATHS = 16  # that a round may draw from
DETECTIONS = ("emission", "link", "off", "radiometer")
HOPPING = ("gated", "always")

# The numbers that a side sees and chooses, in their order; docs/reference/rules.md has their scales.
_PLACES = tuple(f"{of} {axis}" for of in ("own position", "relative position") for axis in "xyz")
OBSERVED = {
    "ally": (
        *_PLACES,
        "own frequency",
        "spreading time",
        "SNR",
        "sensed centre",
        *(f"sensed type {kind}" for kind in JAMMING_TYPES),
        "sensed cover",
    ),
    "opponent": (
        *_PLACES,
        "known frequency",
        "age",
        "next check",
        "own jamming centre",
        *(f"own jamming type {kind}" for kind in JAMMING_TYPES),
        "last check",
    ),
}
CHOSEN = {
    "ally": (
        "hop gate",
        "spread gate",
        "speed",
        "preference",
        "knowledge gate",
        *(f"strategy score {kind}" for kind in JAMMING_TYPES),
    ),
    "opponent": (
        *(f"type score {kind}" for kind in JAMMING_TYPES),
        "tuning",
        "tuning reference",
        *(f"velocity {axis}" for axis in "xyz"),
    ),
}
