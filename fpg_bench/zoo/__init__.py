"""The zoo of trained agents: its contents, and its committed scores."""
