"""Positions that are chosen one by one during a measurement."""
