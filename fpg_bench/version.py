"""Version of the package."""

__version__ = "0.2.0"


def versions() -> dict[str, str]:
    """Return the versions of the software that plays the game."""
    import platform

    import numpy as np

    return {"fpg_bench": __version__, "numpy": np.__version__, "python": platform.python_version()}
