"""The serial port: transport, the recorder process, and the live stream."""
