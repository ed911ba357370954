"""What everything stands on, from errors to frames; numpy at most when it is imported, never JAX."""
