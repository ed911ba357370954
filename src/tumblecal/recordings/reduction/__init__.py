"""Reduction to position means: of captures, tables and recordings of one or several files."""
