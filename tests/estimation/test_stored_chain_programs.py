"""A chain's programs from disk: the next process traces nothing, and another chain never gets them."""

import importlib.util
import os

import jax
import numpy as np
import pytest

import compiled_once
from tumblecal.chain import nominal_chain, settings
from tumblecal.chain.plan import grid
from tumblecal.effects import catalogue
from tumblecal.estimation import programs as programs_module
from tumblecal.estimation.chain_programs import programs_of
from tumblecal.estimation.program_key import described
from tumblecal.ground.program_cache import keep_programs_in


@pytest.fixture
def exports(tmp_path, monkeypatch):
    """Programs are kept in a folder of their own; a list that grows with each one that is traced and exported."""
    from jax import export

    made, real = [], export.export

    def counted(*arguments, **options):
        made.append(arguments)
        return real(*arguments, **options)

    monkeypatch.setattr(export, "export", counted)
    keep_programs_in(tmp_path / "programs")
    yield made
    compiled_once.keep_programs()


def settings_of(pitches):
    plan = grid(np.arange(0.0, 360.0, 90.0), pitches)
    return settings(plan.alpha, plan.beta)


def evaluated(chain):
    """Readings, Jacobian and inputs by programs that are read from disk, as in a process that has none yet."""
    programs_module._from_disk.cache_clear()
    where = settings_of([0.0, 45.0, 90.0])
    names = len(chain.names)
    programs = programs_of(chain, np.arange(names), chain, where, chain.vector, chain.scales)
    vector = chain.vector + 1e-3 * np.cos(np.arange(names))
    return [np.asarray(part) for part in programs.evaluate(where, vector, chain.scales)]


def chain_with(power):
    entry = catalogue()[f"{power}_order.z"]
    return nominal_chain(settings_of([0.0, 45.0, 90.0])) + entry.make(None)[0]


def test_the_next_process_traces_nothing_and_gives_the_same_bits(exports):
    first = evaluated(chain_with("second"))
    assert len(exports) >= 3
    count = len(exports)
    again = evaluated(chain_with("second"))
    assert len(exports) == count
    assert all(np.array_equal(*both) for both in zip(first, again, strict=True))
    other = evaluated(chain_with("third"))
    assert len(exports) > count and not np.array_equal(other[1], first[1])


def test_a_function_is_its_code_its_file_and_what_it_closes_over(tmp_path):
    def of(power):
        return lambda u: u**power

    def key(value):
        return "|".join(described(value))

    assert key(of(2)) == key(of(2)) != key(of(3)) and " at 0x" not in key((of(2), jax.jit(of(2))))
    sources = ["half = 0.5\ndef own(u):\n    return half * u\n", "half = 0.4\ndef own(u):\n    return half * u\n"]
    keys = []
    for number, source in enumerate(sources):
        path = tmp_path / "effects.py"  # edited and loaded again
        path.write_text(source)
        os.utime(path, (0, number))
        spec = importlib.util.spec_from_file_location("user_effects", path)
        module = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(module)
        keys.append(key(module.own))
    assert keys[0] != keys[1]
    assert key(catalogue()["second_order.x"].make(None)) == key(catalogue()["second_order.x"].make(None))
