"""Simulation studies: how often, how well, from how many positions."""
