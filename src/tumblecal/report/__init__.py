"""Figures, pages, terminal tables, result files: what people and programs read."""
