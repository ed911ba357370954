"""The intervals at rest of a recording."""
