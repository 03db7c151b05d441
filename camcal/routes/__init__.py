"""Other calibration methods: poses, triangulation, straight lines, vanishing points, self-calibration, rigs."""
