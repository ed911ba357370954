"""`tumblecal ports`: the serial devices of this machine."""


def ports() -> None:
    """List the serial devices: stable name for a plan, description, USB ids, and the process that uses it."""
    from pathlib import Path

    from rich import box
    from rich.console import Console
    from rich.table import Table

    from tumblecal.capture.port.transport import available, holder_of

    devices = available()
    if not devices:
        print("no serial device found; check its cable")
        return
    table = Table(box=box.SIMPLE)
    for name in ("port", "device", "USB id", "serial number", "in use by"):
        table.add_column(name)
    for device in devices:
        ids = (
            f"{device.vendor:04x}:{device.product:04x}"
            if device.vendor is not None and device.product is not None
            else ""
        )
        holder = holder_of(Path(device.url)) or ""
        table.add_row(device.url, device.description or "", ids, device.serial_number or "", holder)
    Console().print(table)
