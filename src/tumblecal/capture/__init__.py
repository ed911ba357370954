"""From the serial port to position means: protocols, recorder, journal, guided run, reduction, virtual instrument.

Nothing here needs JAX. What does (the live estimate, the virtual instrument's exact truth) is a plain callable
that the command line passes in.
"""
