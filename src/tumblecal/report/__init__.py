"""Figures, pages, terminal tables, result files: what people and programs read."""

import logging


# Without a folder that it can write to, it warns on import about the place of its cache.
logging.getLogger("matplotlib").setLevel(logging.ERROR)
