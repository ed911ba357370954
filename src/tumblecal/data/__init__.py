"""Position sets, units, CSV and Parquet, calibration files, the paper's tables. Needs no JAX."""
