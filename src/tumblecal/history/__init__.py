"""Every calibration and diagnosis of every unit, kept in one file; what moved between two of them, and over time."""
