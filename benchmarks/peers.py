"""The methods of other programs and tumblecal on the same files: errors at attitudes that no fit used.

    python benchmarks/peers.py DATA --imu-tk FOLDER

DATA and FOLDER are those of `benchmarks/recordings.py`. Each set of position means is split four times: three quarters of its
positions are fitted, the rest is corrected. At rest the corrected size must be 1 g; its error is known without angles. The
methods of others are written here by their equations: they fit the same positions, not their choice of intervals.
"""

import time
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from scipy.linalg import sqrtm
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from command_line import asked, print_head, print_row
from in_process import ran
from recordings import IMU_TK, MEANS_HASSAN, PHONE, STATIC_CARLSSON, STATIC_MIKOFF, positions_of, reduced
from tumblecal import load
from tumblecal.data import PositionSet, write_positions


Correct = Callable[[np.ndarray], np.ndarray]
FOLDS = 4
# An attitude is a face if one axis has at least this share of gravity.
FACE = 0.97
SIMULATED = {"simulated: six faces by hand": False, "simulated: 24 positions of a head": True}


class NoFit(Exception):
    """These positions do not allow the method."""


def by_size(matrix: Callable[[np.ndarray], np.ndarray], start: list[float]) -> Callable[[np.ndarray], Correct]:
    """A fit of the size of gravity: `f = matrix(p) (a - b)`, b the last three parameters."""

    def fitted(a: np.ndarray) -> Correct:
        if len(a) < len(start) + 3:
            raise NoFit

        def size(p: np.ndarray) -> np.ndarray:
            return np.linalg.norm((a - p[-3:]) @ matrix(p).T, axis=1) ** 2 - 1

        p = least_squares(size, [*start, 0.0, 0.0, 0.0], method="lm").x
        return lambda raw: (raw - p[-3:]) @ matrix(p).T

    return fitted


def upper(p: np.ndarray) -> np.ndarray:
    """imu_tk: T K, T upper triangular with ones on its diagonal."""
    return np.array([[1, p[3], p[4]], [0, 1, p[5]], [0, 0, 1]]) * p[:3]


def lower(p: np.ndarray) -> np.ndarray:
    """Kalibr: the inverse of a lower triangular M, without the rotation C to the camera."""
    return np.linalg.inv(np.array([[p[0], 0, 0], [p[3], p[1], 0], [p[4], p[5], p[2]]]))


def ellipsoid(a: np.ndarray) -> Correct:
    """accelcal: an ellipsoid by linear least squares of its quadric."""
    if len(a) < 9:
        raise NoFit
    x, y, z = a.T
    columns = np.column_stack([x * x, y * y, z * z, 2 * x * y, 2 * x * z, 2 * y * z, 2 * x, 2 * y, 2 * z])
    v = np.linalg.lstsq(columns, np.ones(len(a)), rcond=None)[0]
    quadric = np.array([[v[0], v[3], v[4]], [v[3], v[1], v[5]], [v[4], v[5], v[2]]])
    centre = -np.linalg.solve(quadric, v[6:])
    root = np.real(sqrtm(quadric / (1 + centre @ quadric @ centre)))
    return lambda raw: (raw - centre) @ root.T


def faces(a: np.ndarray) -> np.ndarray:
    """The reading nearest to each of the six faces, axis by axis, up and down.

    **Raises:** `NoFit` if there is none.
    """
    share = a / np.linalg.norm(a, axis=1)[:, None]
    at = [(int(np.argmax(sign * share[:, axis])), sign, axis) for axis in range(3) for sign in (1, -1)]
    if any(sign * share[row, axis] < FACE for row, sign, axis in at):
        raise NoFit
    return np.array([a[row] for row, _, _ in at]).reshape(3, 2, 3)


def six_positions(a: np.ndarray) -> Correct:
    """Six-position test, PX4: bias and scale factor of each axis by its two faces."""
    pairs = faces(a)
    up, down = pairs[range(3), 0, range(3)], pairs[range(3), 1, range(3)]
    return lambda raw: (raw - (up + down) / 2) / ((up - down) / 2)


def ferraris(a: np.ndarray) -> Correct:
    """imucal: bias and full matrix by six faces, which are assumed to be exact."""
    pairs = faces(a)
    bias, matrix = pairs.mean((0, 1)), ((pairs[:, 0] - pairs[:, 1]) / 2).T
    return lambda raw: np.linalg.solve(matrix, (raw - bias).T).T


METHODS: dict[str, Callable[[np.ndarray], Correct]] = {
    "six-position test, PX4": six_positions,
    "imucal (Ferraris)": ferraris,
    "ArduPilot (bias, scale)": by_size(lambda p: np.diag(p[:3]), [1.0, 1.0, 1.0]),
    "ellipsoid (accelcal)": ellipsoid,
    "imu_tk": by_size(upper, [1.0, 1.0, 1.0, 0.0, 0.0, 0.0]),
    "Kalibr's model": by_size(lower, [1.0, 1.0, 1.0, 0.0, 0.0, 0.0]),
}


def tumblecal(command: str, data: PositionSet, folder: Path) -> tuple[Correct, float | None, str]:
    """The calibration of `calibrate` or `diagnose`, U of a corrected reading (g; None if it is not stated), and its use.

    **Raises:** `NoFit` if no calibration is written.
    """
    write_positions(folder / "fold.csv", data)
    (folder / command / "calibration.json").unlink(missing_ok=True)
    ran([command, folder / "fold.csv", "--no-figures", "--out", folder / command])
    if not (folder / command / "calibration.json").exists():
        raise NoFit
    calibration = load(folder / command / "calibration.json")
    return calibration.corrected, calibration.use.expanded_g, str(calibration.use.answer)


def sets(data: Path, imu_tk: Path | None, out: Path) -> Iterator[tuple[str, list[PositionSet]]]:
    """The sets of position means, by their origin."""
    mikoff = [reduced(data / f"mikoff_mpu9150/imu{k}.log", out / f"m{k}", STATIC_MIKOFF)[0] for k in range(5)]
    yield "mikoff: 5 MPU-9150 in the hand", [positions_of(folder) for folder in mikoff]
    for name in ("exp_1", "exp_7"):
        source, folders = data / f"carlsson_mimu4444/{name}.bin", list[Path]()
        for k in range(1, 9):
            folders.append(reduced(source, out / f"{name}{k}", STATIC_CARLSSON.format(imu=f"imu{k}"))[0])
        yield f"Carlsson {name}: 8 MPU-9150 in a holder", [positions_of(folder) for folder in folders]
    tables = [
        reduced(data / f"hassan_lis3dh_30pos/tab{k}.csv", out / f"h{k}", f"{MEANS_HASSAN} --unit g")
        for k in (24, 31, 49)
    ]
    yield "Hassan: an AHRS, three tables", [positions_of(folder) for folder, _ in tables]
    phone, _ = reduced(data / PHONE, out / "p", "--static --rate 30 --columns ax=1,ay=2,az=3")
    yield "Hassan: a phone in the hand", [positions_of(phone)]
    if imu_tk is not None:
        yield "imu_tk: its example", [positions_of(reduced(imu_tk / "xsens_acc.mat", out / "i", IMU_TK)[0])]


def simulated(rng: np.random.Generator, *, head: bool) -> tuple[PositionSet, np.ndarray]:
    """A triad at six faces set by hand (tilted by 0.5 deg), or at 24 positions of a head (mount turned by 1 deg, pitch errors
    of 3 mrad), with a nonlinearity of z of 1 mg/g^2; and its readings at 300 random attitudes."""
    bias, scale = 0.02 * rng.normal(size=3), np.eye(3) + np.diag(0.005 * rng.normal(size=3))
    triad = scale @ (np.eye(3) + np.tril(0.005 * rng.normal(size=(3, 3)), -1))

    def reading(force: np.ndarray) -> np.ndarray:
        return force @ triad.T + bias + head * 1e-3 * np.array([0, 0, 1.0]) * force**2

    alpha, beta = np.array([0.0, 180, 90, 270, 0, 0]), np.array([0.0, 0, 0, 0, 90, -90])
    turn = Rotation.from_rotvec(np.radians(0.5) * rng.normal(size=(6, 3)))
    pitch = 0.0
    if head:
        alpha, beta = np.tile(np.arange(0, 360, 45.0), 3), np.repeat([0.0, 45, 90], 8)
        turn, pitch = (
            Rotation.from_rotvec(np.radians(1.0) * rng.normal(size=3)),
            np.repeat(3e-3 * rng.normal(size=3), 8),
        )
    a, b = np.radians(alpha), np.radians(beta) + pitch
    force = np.column_stack([-np.sin(b), np.sin(a) * np.cos(b), np.cos(a) * np.cos(b)])
    readings = reading(turn.apply(force)) + 1e-4 * rng.normal(size=force.shape)
    comments = {} if head else {"attitudes": "hand"}
    free = rng.normal(size=(300, 3))
    data = PositionSet.from_arrays(
        readings, alpha, beta, unit="deg", sd=np.full(readings.shape, 1e-4), comments=comments
    )
    return data, reading(free / np.linalg.norm(free, axis=1)[:, None])


def errors_of(fit: Callable[[PositionSet], Correct], data: PositionSet, held: np.ndarray | None) -> np.ndarray:
    """Errors of the size of corrected readings, g: of those in `held`, or of the positions of all folds."""
    if held is not None:
        return np.linalg.norm(fit(data)(held), axis=1) - 1
    number, errors = np.arange(len(data)), np.zeros(len(data))
    for fold in range(FOLDS):
        held_out = number % FOLDS == fold
        corrected = fit(data.chosen(np.flatnonzero(~held_out)))(data.readings[held_out])
        errors[held_out] = np.linalg.norm(corrected, axis=1) - 1
    return errors


def main() -> None:
    options = asked(__doc__, data=(), imu_tk=Path, seed=1)
    print_head("data", "method", "units", "rms error / mg", "largest", "time of a fit / ms", "use and median U")
    with TemporaryDirectory() as name:
        out = Path(name)
        rng = np.random.default_rng(options.seed)
        made = {title: [simulated(rng, head=head) for _ in range(20)] for title, head in SIMULATED.items()}
        for title, units in (*made.items(), *sets(options.data.resolve(), options.imu_tk, out)):
            for method, fit in METHODS.items():
                compare(title, method, units, lambda data, fit=fit: fit(data.readings), {})
            for command in ("calibrate", "diagnose"):
                within: dict[str, list[float]] = {}

                def ours(data: PositionSet, command: str = command, within: dict[str, list[float]] = within) -> Correct:
                    correct, expanded, answer = tumblecal(command, data, out)
                    within.setdefault(answer, []).append(np.nan if expanded is None else expanded)
                    return correct

                compare(title, f"tumblecal {command}", units, ours, within)


def compare(
    title: str,
    method: str,
    units: list[PositionSet] | list[tuple[PositionSet, np.ndarray]],
    fit: Callable[[PositionSet], Correct],
    within: Mapping[str, list[float]],
) -> None:
    """Print the row of a method for some units."""
    errors, seconds = list[np.ndarray](), -time.perf_counter()
    for data in units:
        try:
            errors.append(errors_of(fit, *(data if isinstance(data, tuple) else (data, None))))
        except NoFit:
            continue
    seconds += time.perf_counter()
    if not errors:
        print_row(title, method, 0, "-", "-", "-", "-")
        return
    mg = 1e3 * np.concatenate(errors)
    uses = ", ".join(
        f"{len(values)} {answer}, median U {1e3 * np.nanmedian(values):.2g} mg" for answer, values in within.items()
    )
    print_row(
        title,
        method,
        len(errors),
        f"{np.sqrt(np.mean(mg**2)):.3g}",
        f"{np.max(np.abs(mg)):.3g}",
        f"{1e3 * seconds / (FOLDS * len(units)):.3g}",
        uses or "none stated",
    )


if __name__ == "__main__":
    main()
