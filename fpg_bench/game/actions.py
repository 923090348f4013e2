"""Indices into an action, the nine floats of a side, which ``names.CHOSEN`` lists."""

from fpg_bench.game.names import CHOSEN, JAMMING_TYPES

# The ally's
HOP_GATE, SPREAD_GATE, SPEED, PREFERENCE, KNOWLEDGE_GATE = range(5)
STRATEGY_SCORES = CHOSEN["ally"].index(f"strategy score {JAMMING_TYPES[0]}")  # the first of one for each type

# The opponent's
TYPE_SCORES = 0  # the first of one for each type
TUNING, IN_BAND_GATE = CHOSEN["opponent"].index("tuning"), CHOSEN["opponent"].index("tuning reference")
VELOCITY = CHOSEN["opponent"].index("velocity x")  # the first of three
