"""The design of a measurement: positions, their order, and what they will tell."""
