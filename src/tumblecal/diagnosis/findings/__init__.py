"""What follows from an explanation: gain, location, limits, coefficients, residuals."""
