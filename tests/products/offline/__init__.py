"""Tests of data sets for offline learning."""
