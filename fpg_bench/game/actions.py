"""Indices into an action, the nine floats of a side, as the rules describe them."""

# The ally's
HOP_GATE, SPREAD_GATE, SPEED, PREFERENCE, KNOWLEDGE_GATE = range(5)
STRATEGY_SCORES = 5  # the first of four

# The opponent's
TYPE_SCORES = 0  # the first of four
TUNING, IN_BAND_GATE = 4, 5
VELOCITY = 6  # the first of three
