"""Figures: a function of a result for each, with the shared panels in `panels` and `residuals`."""
