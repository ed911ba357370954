"""What checks shapes and types at run time: beartype, with an int wherever a float may stand (PEP 484)."""

from beartype import BeartypeConf, beartype


checked = beartype(conf=BeartypeConf(is_pep484_tower=True))
