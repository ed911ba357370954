"""The order of positions under slow noise, with the costs of transitions."""
