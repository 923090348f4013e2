"""Settings shared by all tests."""

from hypothesis import settings

# Derandomised: a test that fails for you fails for everybody. No deadlines: no test measures time.
settings.register_profile("fpg_bench", deadline=None, derandomize=True, max_examples=60)
settings.load_profile("fpg_bench")
