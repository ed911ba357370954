"""Criteria of a plan, and their values for a growing and shrinking set of positions."""
