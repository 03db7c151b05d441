"""Other ways to a camera: poses, triangulation, straight lines, rooms, self-calibration."""
