"""Many data sets diagnosed, in this process or in several."""

from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context

import cloudpickle

from tumblecal.chain import Chain
from tumblecal.data import PositionSet
from tumblecal.diagnosis.diagnose import Diagnoser
from tumblecal.diagnosis.diagnosis import Diagnosis
from tumblecal.effects import Catalogue, Effect
from tumblecal.effects.catalogue import with_effects
from tumblecal.estimation.priors import Priors
from tumblecal.ground.errors import InputError
from tumblecal.ground.precision import enable_float64
from tumblecal.ground.program_cache import keep_programs_in, program_cache


def diagnose_many(
    sets: Sequence[PositionSet],
    effects: Iterable[Effect] = (),
    *,
    entries: Catalogue | None = None,
    chain: Chain | None = None,
    noise_sd: float | None = None,
    priors: Priors | None = None,
    nested: bool = False,
    workers: int = 1,
) -> Iterator[Diagnosis | InputError]:
    """Diagnose data sets one after the other; programs are compiled once for each kind of plan.

    **Arguments:**

    - `sets`: position sets. `nested`: whether causes are selected again in every fold of the cross-validation (slower).
    - `workers`: number of processes. They are spawned: call this under `if __name__ == "__main__":`.
    - the others as of `diagnose`, the same for all sets.

    **Returns:** an iterator over the diagnoses in the order of the sets; for a set that cannot be diagnosed the error.

    Examples:
        >>> import tumblecal
        >>> rig = tumblecal.read_rig("hidden_effect")
        >>> sets = [tumblecal.simulate(rig, seed=seed, noise_sd=0.1e-3) for seed in (4, 5)]
        >>> [diagnosis.verdict for diagnosis in tumblecal.diagnose_many(sets, noise_sd=0.1e-3)]
        ['ambiguous', 'ambiguous']
    """
    options = {"chain": chain, "noise_sd": noise_sd, "priors": priors}
    diagnoser = Diagnoser(with_effects(effects, entries), nested=nested)
    if workers <= 1 or len(sets) < 2:
        yield from (_one(diagnoser, data, options) for data in sets)
        return
    cache = program_cache()
    folder = None if cache is None else cache.folder
    # The effects of the user are functions of a script, which the standard pickle cannot send.
    sent = cloudpickle.dumps((diagnoser.entries, nested, options))
    pool = ProcessPoolExecutor(workers, get_context("spawn"), initializer=_begin, initargs=(sent, folder))
    try:
        yield from pool.map(_in_worker, sets)
    finally:
        pool.shutdown(cancel_futures=True)


def _one(diagnoser: Diagnoser, data: PositionSet, options: dict) -> Diagnosis | InputError:
    try:
        return diagnoser(data, **options)
    except InputError as fault:
        return fault


_worker: tuple[Diagnoser, dict] | None = None


def _begin(sent: bytes, folder) -> None:
    """Prepare a worker process."""
    global _worker
    enable_float64()
    if folder is not None:
        keep_programs_in(folder)
    entries, nested, options = cloudpickle.loads(sent)
    _worker = Diagnoser(entries, nested=nested), options


def _in_worker(data: PositionSet) -> Diagnosis | InputError:
    assert _worker is not None
    diagnoser, options = _worker
    return _one(diagnoser, data, options)
