"""`tumblecal ports`: the serial devices of this machine."""


def ports() -> None:
    """List the serial devices: stable name for a plan, description, USB ids, and the process that uses it."""
    from pathlib import Path

    from tumblecal.capture.port.transport import available, holder_of
    from tumblecal.show.tables import Table

    rows = list[list[str]]()
    for device in available():
        ids = "" if device.vendor is None else f"{device.vendor:04x}:{device.product or 0:04x}"
        words = (device.description, ids, device.serial_number, holder_of(Path(device.url)))
        rows.append([device.url, *(text or "" for text in words)])
    header = ("port", "device", "USB id", "serial number", "in use by")
    print(Table(header, rows) if rows else "no serial device found; check its cable")
