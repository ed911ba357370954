"""What no entry describes: errors that follow something, whatever their curve."""
