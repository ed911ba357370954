"""The guided run of a capture: prompts, dwells, checks, and the operator's screen."""
