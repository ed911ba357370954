"""Results for people: words, tables, figures and pages."""

import logging


# Without a folder that it can write to, it warns on import about the place of its cache.
logging.getLogger("matplotlib").setLevel(logging.ERROR)
