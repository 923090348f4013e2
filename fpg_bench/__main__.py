"""``python -m fpg_bench``: the command line."""

from fpg_bench.cli.main import main

if __name__ == "__main__":
    main()
