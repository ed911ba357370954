"""Consequences of an explanation: improvement, location, limits, coefficients, residuals."""
