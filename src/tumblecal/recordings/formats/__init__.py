from tumblecal.recordings.formats import text
from tumblecal.recordings.table import Source


def tables_of(path, options, damage):
    return text.READER, [table.plain() for table in text.READER.read(Source(path, options, damage))]
