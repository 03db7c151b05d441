"""Numbers of floating-point arithmetic that several rooms share."""

#: stands for 0 as a divisor or under a logarithm: below every quantity that occurs, and its inverse is finite
TINY = 1e-300
