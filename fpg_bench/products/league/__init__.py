"""League training: best responses to a player, self-play against the past, champions against populations."""

from fpg_bench.training import require_libraries

require_libraries()
