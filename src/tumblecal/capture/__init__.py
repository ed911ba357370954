"""From the serial port to the raw log and the journal of a guided run.

`protocols` and `decoding`: bytes to samples, and their losses. `port`: the serial port and its recorder.
`capture_plan`, `journal`, `log`: the files of a run. `run`: the guided run. `chamber`: its temperatures.
`emulator`: a virtual instrument.

Nothing here needs JAX. What does (the virtual instrument's exact truth) is a plain callable that the command line passes in.
"""
