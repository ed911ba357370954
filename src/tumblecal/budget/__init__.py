"""Uncertainty budgets (JCGM 100 and 101): what is considered beside the noise, carried through the fit's own Jacobian."""
