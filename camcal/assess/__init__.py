"""The quality of a calibration: error figures, covariance, difference of two cameras, warnings."""
