"""Simulation at scale: noise models, position means, batched estimation, studies, clusters."""
