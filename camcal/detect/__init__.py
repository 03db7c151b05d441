"""From pictures to observations: what a target is, where it is in a picture, its points to a fraction of a pixel."""
