"""The rows of a recording as samples: order, damage and repair."""
