"""Every effect of the sensor reaches the calibration, or is named with its reason and size; the same for every export.

The readings are simulated without noise, from the formulas of the effects alone, here and in the blind instrument (numpy). They
are fitted by the program's chain, and the calibration is applied at other attitudes and temperatures.
"""

import shutil
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

import blind_instrument as blind
from device_formulas import FORMULAS, applied
from independent import Instrument, mount, passive, specific_force
from independent import readings as linear_readings
from tumblecal.data import PositionSet
from tumblecal.data.calibration import calibration_text, read_calibration
from tumblecal.devices import TARGETS, Export, losses
from tumblecal.effects import output_effect
from tumblecal.effects.catalogue import belongs_to, catalogue
from tumblecal.effects.effect import NO_FORMS, OF_BRANCH, OF_GROUPS, OF_MOUNT, OF_PATH, OF_RESOLUTION, OF_RUN
from tumblecal.estimation import problem_of
from tumblecal.estimation.fit import Code, Fit
from tumblecal.full_model.full_model import model_of
from tumblecal.lab.record import calibration_of


G = 9.81
SPAN = (-20.0, 60.0)
SIZE = 2e-3  # of each effect, g in the readings of the data, about
RNG = np.random.default_rng(41)


def _mine(id, axis, term, forms):
    return output_effect(
        id, axis, term, unit="mg", typical=1.0, physics="", cause="", forms=forms, needs=("temperature_degc",)
    )


ORDERS = {"quadratic": 2, "cubic": 3, "quartic": 4, "quintic": 5}


# A user's own: scale factor with the third power of the temperature, a kink that follows it, and one of no stated form.
MINE = {
    effect.id: effect
    for effect in (
        _mine(
            "my_cubic",
            "y",
            lambda u, where: u[1] * (where.temperature_degc - 20.0) ** 3,
            [{"axis": "y", "powers": [0, 1, 0], "degc_power": 3, "reference_degc": 20.0}],
        ),
        _mine(
            "my_kink",
            "z",
            lambda u, where: abs(u[0] * u[1]) * (where.temperature_degc - where.temperature_degc.mean()),
            [{"axis": "z", "powers": [1, 1, 0], "kind": "abs", "degc_power": 1, "reference_degc": "mean"}],
        ),
        _mine("my_own", "z", lambda u, where: u[0] ** 2 * u[1], []),
    )
}
ENTRIES = catalogue() | MINE
SENSOR = [id for id, effect in ENTRIES.items() if belongs_to(effect) == "sensor"]
READOUT = [id for id in SENSOR if ENTRIES[id].found_as]


def plan():
    """Six temperatures and two runs of five pitch settings and eight spindle angles; in the second run the triad is turned
    about its z axis, so that no axis lies along the spindle throughout."""
    alpha, beta = (grid.ravel() for grid in np.meshgrid(np.arange(0, 360, 45.0) + 5, [-80.0, -35.0, 10.0, 40.0, 75.0]))
    parts = [((-20.0, -5.0), "1"), ((10.0, 25.0), "1"), ((42.0, 60.0), "2"), ((25.0, 10.0), "2")]
    count = len(alpha)
    order = np.concatenate([RNG.permutation(count) for _ in parts]) + count * np.repeat(np.arange(len(parts)), count)
    alpha, beta = np.tile(alpha, len(parts))[order], np.tile(beta, len(parts))[order]
    degc = np.repeat([own for pair, _ in parts for own in pair], count // 2) + RNG.normal(0, 1.0, len(alpha))
    time = 60.0 * np.arange(len(alpha)) + RNG.uniform(0, 20, len(alpha))
    run = np.repeat([own for _, own in parts], count)
    turn = passive("z", np.where(run == "2", np.pi / 2, 0.0))
    return SimpleNamespace(alpha=alpha, beta=beta, degc=degc, time=time, run=run, turn=turn)


PLAN = plan()
TRUE = Instrument(
    dK=np.array([30e-3, -22e-3, 11e-3]),
    bias=np.array([14e-3, -9e-3, 6e-3]),
    dtheta=np.array([2e-3, -1e-3, 1.5e-3]),
    gamma=np.array([1e-3, -2e-3, 0.5e-3]),
    dbeta=np.zeros(len(PLAN.alpha)),
)
TRIAD = np.array([[1, 0, 0], [TRUE.gamma[0], 1, 0], [TRUE.gamma[1], TRUE.gamma[2], 1]])


def added(id, u, where):
    """What an effect of coefficients 1 adds to the readings (rows, 3) for inputs u: (coefficients, rows, 3); `where` has degc,
    time, run and pitch setting of each row, in measuring order, and the rows of the data's mean temperature and start."""
    kind, _, axis = id.partition(".")
    k, nil = "xyz".index(axis[:1] or "x"), np.zeros(len(u))
    setup = blind.Setup(nil, nil, where.time, where.degc, nil, where.pitch, {})
    one, warm, time = np.ones(len(u)), where.degc - 25.0, where.time - PLAN.time[0]
    before = np.r_[0, np.arange(len(u) - 1)]
    before = np.where(where.run[before] == where.run, before, np.arange(len(u)))

    parameter, _, order = kind.rpartition("_")

    def on(own, signal):
        table = np.zeros((len(u), 3))
        table[:, own] = signal
        return table

    match kind:
        case _ if order in ORDERS and parameter in ("bias_temperature", "scale_temperature"):
            factor = u[:, k] if parameter == "scale_temperature" else one
            signals = [factor * warm**power for power in range(1, ORDERS[order] + 1)]
        case "bias_temperature_square":
            signals = [(where.degc - PLAN.degc.mean()) ** 2]
        case "bias_hysteresis":
            # Soaks from -20 up to 60, then down to 10 degC.
            signals = [np.select([time < 60 * 20, time < 60 * 120], [0.0, 1.0], -1.0)]
        case "temperature_rate":
            passed = where.time - where.time[before]
            signals = [60 * (where.degc - where.degc[before]) / np.where(passed > 0, passed, 1.0)]
        case "run_drift":
            signals = [np.where(where.run == run, where.time - where.time[where.run == run][0], 0) for run in "12"]
        case "bias_repeatability":
            return [on(own, one * (where.run == "2")) for own in range(3)]
        case "warm_up":
            return [on(own, np.exp(-time / (0.07 * np.ptp(PLAN.time)))) for own in range(3)]
        case "settling":
            new = np.r_[True, (where.pitch[1:] != where.pitch[:-1]) | (where.run[1:] != where.run[:-1])]
            since = where.time - where.time[new][np.cumsum(new) - 1]
            return [on(own, np.exp(-since / np.median(np.diff(PLAN.time)))) for own in range(3)]
        case "temperature_lag":
            # Closed form on each line between positions: the lag tends to rate times tau.
            lag, tau = np.zeros_like(time), 1.5 * np.median(np.diff(PLAN.time))
            for n in range(1, len(time)):
                passed = time[n] - time[n - 1]
                limit = tau * (where.degc[n] - where.degc[n - 1]) / passed
                lag[n] = limit + (lag[n - 1] - limit) * np.exp(-passed / tau)
            return [on(own, lag) for own in range(3)] + [on(own, u[:, own] * lag) for own in range(3)]
        case "my_cubic":
            return [on(1, u[:, 1] * (where.degc - 20.0) ** 3)]
        case "my_kink":
            return [on(2, np.abs(u[:, 0] * u[:, 1]) * (where.degc - PLAN.degc.mean()))]
        case "my_own":
            return [on(2, u[:, 0] ** 2 * u[:, 1])]
        case _:
            signals = blind.of_an_axis(setup, u, k, (where.run == "2").astype(int))[id]
    return [on(k, signal) for signal in signals]


def simulated(id):
    """Readings of the plan with an effect of about `SIZE`, without it, and the coefficients."""
    alpha, beta = np.radians(PLAN.alpha), np.radians(PLAN.beta)
    f = mount(TRUE.dtheta).apply(PLAN.turn.apply(specific_force(alpha, beta)))
    without = linear_readings(alpha, beta, TRUE, PLAN.turn)
    pitch = np.unique(PLAN.beta, return_inverse=True)[1]
    where = SimpleNamespace(degc=PLAN.degc, time=PLAN.time, run=PLAN.run, pitch=pitch)
    if id.startswith("mount_"):
        follows = PLAN.time - PLAN.time[0] if id == "mount_drift" else PLAN.degc - 25.0
        follows = (pitch == 0) * 1.0 if id == "mount_by_pitch" else follows
        angles = np.outer(follows, [1.0, -0.5, 0.7]) * SIZE / np.max(np.abs(follows))
        return ((1 + TRUE.dK) * (mount(angles).apply(f) @ TRIAD.T) + TRUE.bias), without, None
    signals = added(id, f @ TRIAD.T, where)
    sizes = np.array([(-0.6) ** n * SIZE / np.max(np.abs(own)) for n, own in enumerate(signals)])
    return without + np.tensordot(sizes, np.array(signals), 1), without, sizes


@pytest.fixture(scope="module")
def model(request):
    """The chain with every effect that this session tests, compiled once, and a problem whose readings are to be replaced."""
    here = [item for item in request.session.items if item.path == request.path and hasattr(item, "callspec")]
    entries = {id: ENTRIES[id] for id in SENSOR if id in {item.callspec.params["id"] for item in here}}
    readings = linear_readings(np.radians(PLAN.alpha), np.radians(PLAN.beta), TRUE, PLAN.turn)
    data = PositionSet(
        tuple(f"p{k}" for k in range(len(readings))), PLAN.alpha, PLAN.beta, readings,
        run=tuple(PLAN.run), mount=tuple(PLAN.run), time_s=PLAN.time, temperature_degc=PLAN.degc,
    )  # fmt: skip
    problem = problem_of(data, noise_sd=1e-4)
    return model_of(problem.chain, problem.where, entries), problem, data


def fitted(model, id, readings):
    """The exact fit of the chain with one effect, time constants kept where they start."""
    whole, problem, data = model
    slot = next(slot for slot in whole.slots if slot.id == id)
    columns, vector = [*range(whole.nominal), *slot.columns], whole.start.copy()
    for _ in range(4):
        evaluation = whole.evaluate(problem.where, vector)
        left = (readings - evaluation.predicted).ravel()
        jacobian = evaluation.jacobian.reshape(len(left), -1)[:, columns]
        vector[columns] += whole.scales[columns] * np.linalg.solve(jacobian.T @ jacobian, jacobian.T @ left)
    extended = replace(problem, readings=readings, data=replace(data, readings=readings)).with_links(*slot.links)
    names = (*whole.names, *slot.names)
    all_columns = [*range(whole.nominal), *slot.all_columns]
    jacobian = evaluation.jacobian.reshape(len(left), -1)[:, all_columns] / 1e-4
    return Fit(
        "exact", extended, names, (*whole.units, *slot.units), vector[all_columns], np.eye(len(names)) * 1e-12,
        left.reshape(-1, 3), 0.0, 3, Code.CONVERGED, jacobian=jacobian,
    )  # fmt: skip


def held_out(id):
    """Forces at 60 attitudes, temperatures, and the readings there; of an effect that the file cannot hold, without it."""
    rng = np.random.default_rng(7)
    f = rng.normal(size=(60, 3))
    f /= np.linalg.norm(f, axis=1)[:, None]
    degc, u = np.repeat([-12.0, 21.0, 55.0], 20), f @ TRIAD.T
    readings = (1 + TRUE.dK) * u + TRUE.bias
    if ENTRIES[id].forms:
        where = SimpleNamespace(degc=degc, time=np.arange(60), run=np.full(60, "1"), pitch=np.zeros(60, int))
        readings += np.tensordot(simulated(id)[2], np.array(added(id, u, where)), 1)
    return f, degc, readings


REASONS = {
    OF_RUN: ("bias_drift", "bias_drift_square", "scale_drift", "misalignment_drift", "warm_up", "settling"),
    OF_GROUPS: ("bias_by_pitch", "scale_by_pitch", "run_drift", "bias_repeatability"),
    OF_BRANCH: ("bias_hysteresis",),
    OF_PATH: ("memory", "hysteresis", "temperature_rate", "temperature_lag"),
    OF_MOUNT: ("mount_drift", "mount_temperature", "mount_by_pitch"),
    OF_RESOLUTION: ("clipping", "quantisation", "dead_zone"),
    NO_FORMS: ("my_own",),
}


def of_job(id):
    """An effect of the x or y axis is tested in the long job: that of z has the same form."""
    return pytest.param(id, marks=pytest.mark.long) if id.partition(".")[2][:1] in ("x", "y") else id


def test_every_entry_of_the_sensor_has_a_form_or_a_reason():
    reasons = {kind: reason for reason, kinds in REASONS.items() for kind in kinds}
    for id in SENSOR:
        kind = id.partition(".")[0]
        assert bool(ENTRIES[id].forms) != (kind in reasons), id
        assert ENTRIES[id].forms or (ENTRIES[id].not_held or NO_FORMS) == reasons[kind]


@pytest.mark.parametrize("id", [of_job(id) for id in SENSOR if id not in READOUT])
def test_the_truth_is_recovered_or_the_loss_is_named_with_its_reason_and_size(model, id, tmp_path):
    readings, without, _ = simulated(id)
    fit = fitted(model, id, readings)
    assert np.max(np.abs(fit.residuals)) < 1e-9
    own = calibration_of(fit, ENTRIES)
    (tmp_path / "calibration.json").write_text(calibration_text(own))
    own = read_calibration(tmp_path / "calibration.json")
    f, degc, held = held_out(id)
    np.testing.assert_allclose(own.corrected(held, degc), f, rtol=0, atol=2e-8)
    lost = [loss for loss in own.not_applied if not loss.effect.startswith("temperature^")]
    if ENTRIES[id].forms:
        assert not lost and {term.effect for term in own.terms} == {id}
        return
    assert [loss.effect for loss in lost] == [id] == own.provenance["not_applied"] and not own.terms
    kind = id.partition(".")[0]
    assert lost[0].reason == next(reason for reason, kinds in REASONS.items() if kind in kinds)
    signal = 1e3 * (readings - without)
    assert lost[0].largest_mg == pytest.approx(np.max(np.abs(signal)), rel=0.02)
    assert lost[0].rms_mg == pytest.approx(np.sqrt(np.mean(signal**2)), rel=0.02)


# One of each form of term.
FORMS = [id for id in SENSOR if ENTRIES[id].forms and id.partition(".")[2][:1] in ("", "z")]


@pytest.mark.parametrize("id", FORMS)
def test_every_export_carries_it_or_lists_it_as_a_loss(model, id):
    """By the target's own formula, over all attitudes and the whole range of temperature."""
    own = calibration_of(fitted(model, id, simulated(id)[0]), ENTRIES)
    rng = np.random.default_rng(3)
    f = np.concatenate([rng.normal(size=(400, 3)), np.eye(3), -np.eye(3)])
    f /= np.linalg.norm(f, axis=1)[:, None]
    degc, u = rng.choice(np.linspace(*SPAN, 9), len(f)), f @ TRIAD.T
    where = SimpleNamespace(degc=degc, time=np.arange(len(f)), run=np.full(len(f), "1"), pitch=np.zeros(len(f), int))
    readings = (1 + TRUE.dK) * u + TRUE.bias + np.tensordot(simulated(id)[2], np.array(added(id, u, where)), 1)
    clear = np.all(np.abs(u) > 0.01, axis=1) | ("bias_asymmetry" not in id)
    for name, target in TARGETS.items():
        if name == "c-header" and not shutil.which("cc"):
            continue
        export = Export(target.carried(own, SPAN), G, ("about",), SPAN)
        text = target.write(export)
        lost = losses(target, export, own, text)
        error = 1e3 * np.max(np.abs(applied(name, text, readings[clear], degc[clear], G) - f[clear]))
        stated = max((loss.mg for loss in lost), default=0.0)
        assert 0.8 * stated - 2e-3 < error < 1.02 * stated + 2e-3, (name, error, [str(loss) for loss in lost])
        thermal_bias = id.startswith("bias_temperature") and "bias temperature" in target.carries
        carried = "terms" in target.carries or thermal_bias
        assert carried != any(id in loss.what for loss in lost), (name, [str(loss) for loss in lost])
    assert FORMULAS.keys() == TARGETS.keys()
