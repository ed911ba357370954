"""What simulates: experiments, position means, batched fits."""
