"""Lists of jobs: the same list on local processes or on a Ray cluster."""
