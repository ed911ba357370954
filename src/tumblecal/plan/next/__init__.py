"""What to measure next: from a diagnosis to a plan."""
