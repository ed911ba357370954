"""What may be wrong: causes of every kind, stacked in one pool."""
