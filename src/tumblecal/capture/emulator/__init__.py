"""A virtual instrument on a dividing head, behind a pseudo-terminal: everything can be tried without hardware."""
