"""The model that a diagnosis looks from: one chain with every effect, and its tangent."""
