"""From bytes to samples: frames, checks, counters, losses, and the recognition of protocols."""
