"""Quantities and units of the columns of a recording, by option, format, name or value."""
