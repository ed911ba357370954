"""Archives of numpy arrays (.npz): arrays of one length are a table."""

import numpy as np

from tumblecal.ground.decoding import decoding, silenced
from tumblecal.recordings.memory import require_size
from tumblecal.recordings.table import Reader, Source, Table, tables_of_arrays


def _read(source: Source) -> list[Table]:
    with decoding(source.path, "npz archive"), silenced(), source.path.open("rb") as file:
        archive = np.load(file, allow_pickle=False)
        infos = archive.zip.infolist()
        needed, there = sum(info.file_size for info in infos), source.path.stat().st_size
        require_size(source.path, "its arrays", needed, 100 * there, "save them again")
        return tables_of_arrays({name: archive[name] for name in archive.files})


READER = Reader("numpy .npz", lambda path, head: head.startswith(b"PK") and b".npy" in head[:200], _read)
