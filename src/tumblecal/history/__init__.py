"""All calibrations and diagnoses of all units in one file; changes between two of them, and over time."""
