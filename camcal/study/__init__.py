"""Data with a known truth: cameras, poses, points with noise, and pictures of targets."""
