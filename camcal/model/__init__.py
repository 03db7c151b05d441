"""The camera: poses, lens models, and a lens model with the values of its parameters."""
