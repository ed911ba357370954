"""Sets of causes: prior, evidence, search, and classes of indistinguishable sets."""
