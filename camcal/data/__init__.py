"""Input and output files: correspondences, pictures, the configuration, and atomic writing."""
