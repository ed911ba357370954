"""Consequences of a result for a laboratory: whether a calibration may be used, and with which uncertainty."""
