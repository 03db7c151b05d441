"""The least-squares loop; see `camcal.least_squares.loop`."""

from camcal.least_squares.loop import minimise
from camcal.least_squares.problem import (
    EDGE,
    STILL,
    Differences,
    Found,
    Normal,
    Options,
    Problem,
    Small,
    Stats,
    Trial,
    damped_steps,
    negligible,
)

__all__ = [
    "EDGE",
    "STILL",
    "Differences",
    "Found",
    "Normal",
    "Options",
    "Problem",
    "Small",
    "Stats",
    "Trial",
    "damped_steps",
    "minimise",
    "negligible",
]
