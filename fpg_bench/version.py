"""The version of the package; every part may say it."""

__version__ = "0.1.0.dev0"
