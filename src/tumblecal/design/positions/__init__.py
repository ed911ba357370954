"""The choice of positions: exchange, bounds of any plan, angles between the grid."""
