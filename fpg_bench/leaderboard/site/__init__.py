"""The leaderboard's page: static, complete in itself, made from a board alone."""

from fpg_bench.extras import need

need("leaderboard", "jinja2")
