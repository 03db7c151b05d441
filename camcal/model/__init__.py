"""What a camera is: poses, lens models, a camera with the values of its parameters."""
