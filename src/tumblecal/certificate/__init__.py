"""Calibration certificates: statements of the laboratory, results, conformity, and the DCC."""
