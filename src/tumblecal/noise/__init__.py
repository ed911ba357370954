"""Noise: parts, Allan deviation, fits, sampling, covariances. numpy only."""
