"""The temperature of a capture: soaks of a plan, the criterion of a stable temperature, and the chamber that is set."""
