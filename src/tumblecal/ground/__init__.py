"""The lowest layer, from errors to frames; its imports need numpy at most, never JAX."""
