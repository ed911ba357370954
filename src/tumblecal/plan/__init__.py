"""The design of a measurement: positions, their order, and forecasts of what they will determine."""
