"""From pictures to observations: targets, their detection in a picture, and their points with sub-pixel accuracy."""
