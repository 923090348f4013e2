"""Submissions, their verified results, and how they rank."""
