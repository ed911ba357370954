"""The forecast of a plan."""
