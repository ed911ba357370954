"""Lack of fit: errors without a catalogue entry that depend on a variable, with any curve."""
