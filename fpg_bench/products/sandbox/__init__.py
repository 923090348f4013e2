"""Policies of others, checked and played in processes that reach no file, no network and no other process."""
