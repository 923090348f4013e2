"""``python -m fpg_bench.cli``."""

from fpg_bench.cli import main

if __name__ == "__main__":
    main()
