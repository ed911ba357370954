"""Blind studies: causes hidden in simulated instruments, answers of the program, and one judge."""
