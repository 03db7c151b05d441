"""How good a calibration is: error figures, covariance, difference of two cameras, warnings."""
