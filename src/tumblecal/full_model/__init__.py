"""One chain with every testable effect, its tangent, and what data state about all effects at once."""
