"""Simulation: experiments, position means, batched fits."""
