"""Recordings: from any log to position means. A format returns tables, `reading` makes one frame in SI units of them."""
