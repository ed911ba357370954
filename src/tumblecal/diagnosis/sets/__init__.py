"""Sets of causes: prior, evidence, search, and the classes that the data cannot tell apart."""
