"""Correction of readings by a calibration, in the format of the source."""
