"""Names of the three axes."""

AXES = ("x", "y", "z")
