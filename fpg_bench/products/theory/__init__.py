"""Players of theory: the Bayes jammer, a planning ally, bandits, and the oracles of the model ``link``."""
