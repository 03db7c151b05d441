"""The plan of a calibration: the estimates that are tried, their order, and the one that is kept."""
