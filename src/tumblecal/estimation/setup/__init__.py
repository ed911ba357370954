"""Set-up errors, found before the fit: units, axes, angles, temperature and time."""
