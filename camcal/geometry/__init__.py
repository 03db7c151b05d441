"""Arrays in, arrays out: rotations, projective geometry, homographies. No options, no I/O."""
