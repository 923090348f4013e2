"""Submissions, their verified results, ranking, seasons and the site."""
