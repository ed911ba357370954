"""Next positions: what is promised is what plain numpy finds, in every ordinary kind of measurement."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import independent
from independent import Instrument
from tumblecal.chain.rig_file import read_rig
from tumblecal.data import PositionSet
from tumblecal.diagnosis import Diagnoser
from tumblecal.effects import catalogue
from tumblecal.estimation.position_problem import where_of
from tumblecal.planning.next_plan import SHARPEN, next_plan
from tumblecal.planning.proposals import SIDES, Allowed


SIGMA = 1e-4
STEP = 1e-6


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


def measured(alpha, beta, run, mount, *, seed=0, dbeta=None):
    """Position means of an adequate instrument, by scipy's rotations."""
    rng = np.random.default_rng(seed)
    groups = np.unique([f"{r} {m} {b}" for r, m, b in zip(run, mount, beta, strict=True)], return_inverse=True)[1]
    errors = rng.normal(0, 2e-4, groups.max() + 1)[groups] if dbeta is None else dbeta
    true = Instrument(*rng.normal(0, 1e-3, (4, 3)), errors)
    readings = independent.readings(np.radians(alpha), np.radians(beta), true)
    return PositionSet(
        tuple(str(k) for k in range(len(alpha))),
        alpha,
        beta,
        readings + SIGMA * rng.normal(size=readings.shape),
        sd=np.full(readings.shape, SIGMA),
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
    zero = {name: np.zeros((len(rows), width)) for name, (_, width) in leaves.items()}

    def readings(values):
        f = independent.specific_force(alpha, beta + values["dbeta"][:, 0])
        f = independent.mount(values["dtheta"]).apply(intended.apply(f))
        g21, g31, g32 = values["gamma"].T
        u = np.stack([f[:, 0], f[:, 1] + g21 * f[:, 0], f[:, 2] + g31 * f[:, 0] + g32 * f[:, 1]], axis=1)
        return (1 + values["dK"]) * u + values["bias"]

    columns, watched, information = [], [], []
    for name, (group, width) in leaves.items():
        if name in fixed:
            continue
        for number in range(group.max() + 1):
            for part in range(width):
                moved = [dict(zero), dict(zero)]
                for sign, values in zip((1, -1), moved, strict=True):
                    values[name] = zero[name].copy()
                    values[name][group == number, part] = sign * STEP
                columns.append((readings(moved[0]) - readings(moved[1])).ravel() / (2 * STEP) / SIGMA)
                watched.append(name in ("dK", "gamma") or (name == "bias" and number == group.max()))
                information.append((prior or {}).get(name, 0.0))
    jacobian = np.stack(columns, axis=1)
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
