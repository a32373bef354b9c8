"""The version of the package, as setup.py and package.xml have it."""

__version__ = "0.1.0"
