"""Static site of the leaderboard, made from a board; it needs no server and no other host."""

from fpg_bench.common.extras import require_extra

require_extra("leaderboard", "jinja2")
