"""The version of camcal, in one place for the package, the build and the reports."""

__version__ = "1.0.0"
