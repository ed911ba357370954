"""Simulation studies: how often, how well, from how many positions; the paper's own; stores and clusters."""
