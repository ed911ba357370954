"""Next positions: what is promised is what plain numpy finds, in every ordinary kind of measurement."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import blind_instrument as blind
import independent
from blind_noise import position_set
from independent import Instrument
from tumblecal.capture.capture_plan import read_plan
from tumblecal.chain.rig_file import read_rig
from tumblecal.data import PositionSet
from tumblecal.diagnosis import Diagnoser
from tumblecal.effects import catalogue
from tumblecal.estimation import exact, problem_of
from tumblecal.estimation.position_problem import where_of
from tumblecal.ground.atomic import write_texts
from tumblecal.plan.next.next_capture import LABELS, next_captures, next_commands
from tumblecal.plan.next.next_plan import SEPARATE, SHARPEN, next_plan
from tumblecal.plan.next.proposals import SIDES, Allowed
from tumblecal.show.next_plan import next_plan_texts


SIGMA = 1e-4


@pytest.fixture(scope="module")
def planner():
    """With few effects, so that a model for each kind of measurement is compiled quickly."""
    kept = ("second_order.z", "scale_asymmetry.z", "cross_axis_square.z", "second_order.y", "index_eccentricity")
    entries = catalogue()
    noise = [id for id, effect in entries.items() if effect.make is None]
    return Diagnoser({id: entries[id] for id in (*kept, *noise)})


def plan12(runs=1, mounts=("1",)):
    """Angles (deg), runs and mounts of half the paper's plan, measured several times."""
    cells = [
        (alpha, beta, str(run + 1), mount)
        for run in range(runs)
        for mount in mounts
        for beta in (0.0, 45.0, 90.0)
        for alpha in np.arange(4) * 90.0
    ]
    alpha, beta, run, mount = zip(*cells, strict=True)
    return np.array(alpha), np.array(beta), run, mount


def measured(alpha, beta, run, mount, *, seed=0, dbeta=None, intended=None, sd=SIGMA):
    """Position means of an adequate instrument, by scipy's rotations."""
    rng = np.random.default_rng(seed)
    groups = np.unique([f"{r} {m} {b}" for r, m, b in zip(run, mount, beta, strict=True)], return_inverse=True)[1]
    errors = rng.normal(0, 2e-4, groups.max() + 1)[groups] if dbeta is None else dbeta
    true = Instrument(*rng.normal(0, 1e-3, (4, 3)), errors)
    readings = independent.readings(np.radians(alpha), np.radians(beta), true, intended)
    return PositionSet(
        tuple(str(k) for k in range(len(alpha))),
        alpha,
        beta,
        readings + sd * rng.normal(size=readings.shape),
        sd=np.full(readings.shape, sd),
        run=run if len(set(run)) > 1 else None,
        mount=mount if len(set(mount)) > 1 else None,
    )


def cells_of(together):
    """Every single position of a set: alpha, beta (deg), side."""
    return [
        (alpha, proposed.beta_deg, proposed.mount)
        for proposed in together
        for alpha in (proposed.turn_deg or (proposed.alpha_deg,))
    ]


def worst_sd(rows, *, bias_by=(), dbeta_by=(0, 1), fixed=(), prior=None):
    """Largest sd of dK, bias of the last rows' group, gamma: by difference quotients of the plain instrument.

    `rows`: (alpha, beta, run, mount, side) each; `dbeta_by`: columns of (beta, mount, run) that tell the dbeta apart.
    """
    alpha, beta = (np.radians([row[k] for row in rows]) for k in (0, 1))
    keys = [(row[1], row[3], row[2]) for row in rows]
    intended = Rotation.from_quat(
        [independent.mount(np.radians(SIDES.get(row[4], (0.0, 0.0, 0.0)))).as_quat() for row in rows]
    )

    def grouped(parts):
        labels = [tuple(key[part] for part in parts) for key in keys]
        order = list(dict.fromkeys(labels))
        return np.array([order.index(label) for label in labels])

    shared = np.zeros(len(rows), int)
    leaves = {
        "dK": (shared, 3),
        "bias": (grouped(bias_by), 3),
        "dtheta": (grouped((1,)), 3),
        "gamma": (shared, 3),
        "dbeta": (grouped(dbeta_by), 1),
    }
    free = [
        (name, number, part)
        for name, (group, width) in leaves.items()
        if name not in fixed
        for number in range(group.max() + 1)
        for part in range(width)
    ]

    def readings(vector):
        values = {name: np.zeros((len(rows), width)) for name, (_, width) in leaves.items()}
        for size, (name, number, part) in zip(vector, free, strict=True):
            values[name][leaves[name][0] == number, part] = size
        true = Instrument(**values | {"gamma": values["gamma"][0], "dbeta": values["dbeta"][:, 0]})
        return independent.readings(alpha, beta, true, intended).ravel() / SIGMA

    jacobian, last = independent.central(readings, 1e-6)(np.zeros(len(free))), leaves["bias"][0].max()
    watched = [name in ("dK", "gamma") or (name, number) == ("bias", last) for name, number, _ in free]
    information = [(prior or {}).get(name, 0.0) for name, *_ in free]
    # At 90 degrees about y two mounting angles turn about one axis: the pseudoinverse leaves the sensor's sd as they are.
    covariance = np.linalg.pinv(jacobian.T @ jacobian + np.diag(information), rcond=1e-13)
    return float(np.sqrt(np.max(np.diag(covariance)[watched])))


def old_rows(data):
    count = len(data)
    run, mount = data.run or ("1",) * count, data.mount or ("1",) * count
    return [(a, b, r, m, "") for a, b, r, m in zip(data.alpha_deg, data.beta_deg, run, mount, strict=True)]


def new_rows(data, together):
    run, mount = (data.run or ("1",))[-1], (data.mount or ("1",))[-1]
    return [(alpha, beta, run, side or mount, side) for alpha, beta, side in cells_of(together)]


KINDS = {
    "one run": {},
    "no remounting": {"allowed": Allowed(remount=False)},
    "a grid": {"allowed": Allowed((10.0, 100.0, 190.0, 280.0), (0.0, 20.0, 45.0, 70.0))},
    "two runs": {"runs": 2, "dbeta_by": (0, 1, 2)},
    "two mountings": {"mounts": ("A", "B"), "allowed": Allowed(remount=False)},
    "a prior": {"priors": {"dbeta": (0.0, 2e-4)}, "prior": {"dbeta": 1 / 2e-4**2}},
}


def of_job(name):
    """Kinds with runs or mountings have programs of their own, and are tested in the long job."""
    return pytest.param(name, marks=pytest.mark.long) if name in ("two runs", "two mountings") else name


@pytest.mark.parametrize("kind", [of_job(name) for name in KINDS])
def test_the_worst_sd_falls_as_promised(planner, kind):
    kind = KINDS[kind]
    allowed = kind.get("allowed", Allowed())
    data = measured(*plan12(kind.get("runs", 1), mounts=kind.get("mounts", ("1",))), seed=3)
    plan = next_plan(planner(data, priors=kind.get("priors")), allowed)
    assert plan.purpose == SHARPEN and plan.together and plan.positions <= 12
    grouping = {name: kind[name] for name in ("dbeta_by", "prior") if name in kind}
    before = worst_sd(old_rows(data), **grouping)
    after = worst_sd(old_rows(data) + new_rows(data, plan.together), **grouping)
    assert 1 - after / before == pytest.approx(plan.value, abs=0.01)
    assert 0.02 < plan.value < 1
    for single in (plan.singles[0], plan.singles[-1]):
        alone = worst_sd(old_rows(data) + new_rows(data, [single]), **grouping)
        assert 1 - alone / before == pytest.approx(single.value, abs=0.01)
    # No other single position or turn of the six is better than the first, and the set is no six copies of it.
    assert [single.value for single in plan.singles] == sorted((single.value for single in plan.singles), reverse=True)
    assert len(set(cells_of(plan.together))) == plan.positions
    for alpha, beta, side in [*cells_of(plan.together), *cells_of(plan.singles)]:
        assert alpha in (allowed.alpha_deg or np.arange(24) * 15.0)
        assert beta in (allowed.beta_deg or np.arange(7) * 15.0)
        assert allowed.remount or not side


RIG = """schema = "tumblecal.rig/1"
[plan]
alpha_deg = [0, 45]
beta_deg = [0, 45]
[chain.leaves.dbeta]
free = false
[chain.leaves.bias]
by = "run"
"""


def test_a_rig_of_ones_own(planner, tmp_path):
    """A chain with fixed dbeta and a bias for each run: new positions belong to the last run; no setting has a dbeta."""
    (tmp_path / "rig.toml").write_text(RIG)
    rig = read_rig(tmp_path / "rig.toml")
    alpha, beta, run, mount = plan12(2)
    data = measured(alpha, beta, run, mount, dbeta=np.zeros(24), seed=4)
    plan = next_plan(planner(data, chain=rig.chain(where_of(data))))
    grouping = {"bias_by": (2,), "fixed": ("dbeta",)}
    before = worst_sd(old_rows(data), **grouping)
    for single in plan.singles:
        after = worst_sd(old_rows(data) + new_rows(data, [single]), **grouping)
        assert 1 - after / before == pytest.approx(single.value, abs=0.005) and single.value > 0.01
    assert any("[mounts] entry" in note for note in plan.notes) == any(turn.mount for turn in plan.together)


def log_odds(diagnosis, first, second):
    """Log posterior odds of two single effects in the screen."""
    ranked, causes = diagnosis.screened.search.ranked(), diagnosis.screened.pool.causes
    single = ranked.members[:, 1] < 0
    scores = {
        causes[members[0]].label: value
        for members, value in zip(ranked.members[single][::-1], ranked.log_posterior[single][::-1], strict=True)
        if members[0] >= 0
    }
    return scores[first] - scores.get(second, min(scores.values()))


@pytest.mark.long
def test_the_proposed_positions_separate_the_explanations(planner):
    """A quadratic z axis looks like a scale asymmetry; measured where proposed, the odds move as was said."""
    allowed = Allowed(beta_deg=(0.0, 45.0, 90.0), remount=False)
    said, got = [], []
    for seed in range(4):
        rng = np.random.default_rng(seed)
        setup = blind.random_setup(rng, 3, 8)
        size, *_ = blind.sized(setup, blind.unreachable(setup), "second_order.z", 8.0, rng)
        effects = {"second_order.z": np.abs(size)}
        readings = blind.readings(setup, setup.nominal, effects) + SIGMA * rng.normal(size=(24, 3))
        diagnosis = planner(position_set(setup, readings, True, columns=False))
        plan = next_plan(diagnosis, allowed)
        if diagnosis.best.labels != ("second_order.z",) or plan.purpose != SEPARATE:
            continue
        # One function at 1 g is no alternative: no position would separate it.
        assert not any("cross_axis_square.z" in note for note in plan.notes)
        more = blind.extended(setup, [(alpha, beta) for alpha, beta, _ in cells_of(plan.together)], rng)
        noisy = blind.readings(more, more.nominal, effects)[24:] + SIGMA * rng.normal(size=(plan.positions, 3))
        again = planner(position_set(more, np.concatenate([readings, noisy]), True, columns=False))
        said.append(plan.value)
        got.append(log_odds(again, "second_order.z", "scale_asymmetry.z"))
        got[-1] -= log_odds(diagnosis, "second_order.z", "scale_asymmetry.z")
        assert "second_order.z" in again.labels
    assert len(said) >= 2
    # The log Bayes factor of one measurement scatters by the root of twice its mean.
    assert np.mean(got) == pytest.approx(np.mean(said), abs=2.5 * np.sqrt(2 * np.mean(said) / len(said)))


@pytest.mark.long
def test_plans_for_capture(planner, tmp_path):
    """The files are good as they are: what they ask for is measured, and the sd fall as was said."""
    data = measured(*plan12(), seed=5)
    data.comments.update(protocol="adxl355", serial_number="N1", gravity_ms2="9.81")
    diagnosis = planner(data)
    proposed = next_plan(diagnosis)
    texts = next_plan_texts(diagnosis, proposed, tmp_path)
    names = [*texts]
    write_texts(tmp_path, texts)
    assert any("turned" in name for name in names)
    steps, sides = [], []
    for name in names:
        plan = read_plan(tmp_path / name)
        side = next((side for side, label in LABELS.items() if label == plan.session.mount), "")
        assert plan.positions.mount_rotation_deg == (list(SIDES[side]) if side else None)
        assert (plan.port.protocol, plan.port.serial_number, plan.site.gravity_ms2) == ("adxl355", "N1", 9.81)
        steps += [(step.alpha_deg, step.beta_deg) for step in plan.steps]
        sides += [plan.session.mount] * len(plan.steps)
    assert sorted(steps) == sorted(cell[:2] for cell in cells_of(proposed.together))

    alpha = np.concatenate([data.alpha_deg, [step[0] for step in steps]])
    beta = np.concatenate([data.beta_deg, [step[1] for step in steps]])
    mount = ("1",) * 12 + tuple(sides)
    turns = {label: SIDES[side] for side, label in LABELS.items()}
    intended = Rotation.from_quat([independent.mount(np.radians(turns.get(m, (0, 0, 0)))).as_quat() for m in mount])
    both = measured(alpha, beta, ("1",) * len(alpha), mount, seed=5, intended=intended)
    # The turn is found from the readings.
    after = exact.fit(problem_of(both))
    before = exact.fit(problem_of(data))
    sensor = [name for name in before.names if name.startswith(("dK", "bias", "gamma"))]
    fall = 1 - max(after.sd[after.names.index(n)] for n in sensor) / max(
        before.sd[before.names.index(n)] for n in sensor
    )
    assert after.code.good and fall == pytest.approx(proposed.value, abs=0.02)
    assert fall > 0.6

    # Where the data state times, a position takes as long as in them; one command diagnoses all files.
    files = ("m.csv", "next/positions.csv")
    timed = replace(diagnosis.screened.problem.measured_data, time_s=150.0 * np.arange(12), files=files)
    again = planner(timed)
    plan = next_plan(again)
    texts = next_plan_texts(again, plan, tmp_path)
    assert all("[dwell]\nseconds = 120.0\nsettle_s = 30.0\n" in text for text in texts.values())
    commands = next_commands(again, next_captures(again, plan), tmp_path)
    assert len(texts) > 1 and len(commands) == 2 * len(texts) + 1
    # A folder of the data is not used a second time.
    measured_in = [command.split()[4] for command in commands if "capture" in command]
    assert measured_in[0] == "next_2" and len({*measured_in}) == len(texts)
    positions = [f"{folder}/positions.csv" for folder in measured_in]
    assert commands[-1].split()[1:] == ["diagnose", "--join", "--same-run", *files, *positions]
    there = next_plan(diagnosis, Allowed(remount=False))
    assert [*next_plan_texts(diagnosis, there, tmp_path)] == ["next_positions.toml"]
