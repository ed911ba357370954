"""Possible errors: causes of every kind, in one pool."""
