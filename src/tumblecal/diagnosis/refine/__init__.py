"""Causes inserted in the model and fitted exactly."""
