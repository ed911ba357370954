"""PTB's schema of a DCC, where it is at hand."""

import importlib.util
import os
from functools import cache
from pathlib import Path


ROOT = Path(__file__).parents[2]


def schema_folder() -> Path | None:
    """PTB's schema files (LGPL, not part of this repository), where they lie beside it."""
    stated = os.environ.get("TUMBLECAL_SCHEMAS")
    places = [Path(stated)] if stated else [ROOT / "shared" / "schemas", ROOT.parent / "shared" / "schemas"]
    return next((place for place in places if (place / "dcc.xsd").exists()), None)


@cache
def schema_of_dcc():
    """The official schema; None where it, or what reads it, is not at hand."""
    folder = schema_folder()
    if folder is None or importlib.util.find_spec("xmlschema") is None:
        return None
    import xmlschema

    return xmlschema.XMLSchema(str(folder / "dcc.xsd"))
