"""Products: each folder is one, described by its ``product.toml``; see :mod:`fpg_bench.common.products`."""
