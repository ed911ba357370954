"""Calibration certificates: what the laboratory states, the results, their conformity, and the DCC."""
