"""Command line: thin verbs over the library; :mod:`fpg_bench.cli.main` puts them together."""
