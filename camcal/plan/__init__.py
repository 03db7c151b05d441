"""The order of a calibration: which estimates are tried, in which order, and which one is kept."""
