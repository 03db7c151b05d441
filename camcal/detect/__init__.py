"""From pictures to observations: targets, their detection, and the sub-pixel location of their points."""
