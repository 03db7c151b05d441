"""Files in and out: correspondences, pictures, the configuration, and writing without half-written files."""
