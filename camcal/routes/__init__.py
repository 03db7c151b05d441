"""Other ways to calibrate a camera: poses, triangulation, straight lines, vanishing points, self-calibration."""
