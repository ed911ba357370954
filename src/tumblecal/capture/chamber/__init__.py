"""The temperature of a capture: the chamber on its line, and the soaks of a plan."""
