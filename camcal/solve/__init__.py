"""Refinement: all poses and the intrinsics together, by nonlinear least squares."""
