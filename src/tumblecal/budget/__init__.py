"""Uncertainty budgets (JCGM 100 and 101): inputs in addition to the noise, carried through the fit's own Jacobian."""
