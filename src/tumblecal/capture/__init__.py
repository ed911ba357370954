"""From the serial port or a recording to position means, and from a calibration to corrected readings.

`protocols` and `decoding`: bytes to samples. `port`: the serial port and its recorder. `run`: the guided run. `emulator`: a
virtual instrument. `recordings`: formats of other programs, whose `columns` are interpreted and whose `rows` are repaired.
`still`: intervals at rest. `reduction`: position means. `correction`: corrected readings.

Nothing here needs JAX. What does (the virtual instrument's exact truth) is a plain callable that the command line passes in.
"""
