"""Factors just below and just above a number that decides something."""

LESS, MORE = 0.999, 1.001
