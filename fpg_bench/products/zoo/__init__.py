"""The zoo: the shipped agents, their records and scores."""
