"""The leaderboard's page: static, complete in itself, made from a board alone."""
