"""Other noises than the one assumed: their covariances, their evidence, their fit."""
