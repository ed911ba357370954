"""Check of a calibration by a few attitudes at rest: consistency, sensitivity, the parameter that changed, and an update."""
