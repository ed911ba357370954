"""Noise models, position means, batches, studies, cluster."""
