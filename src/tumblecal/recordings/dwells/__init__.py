"""The dwells of a measurement: samples by position, from captures, columns, rest, files or means."""
