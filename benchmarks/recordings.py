"""Public recordings from their original files to positions and verdicts, against the answers that are known of them.

    python benchmarks/recordings.py DATA --imu-tk FOLDER

DATA contains the folders `mikoff_mpu9150`, `suarez_mpu6050`, `carlsson_mimu4444`, `hassan_lis3dh_30pos`, `imucal_ferraris`
and `bmi270_thermal` (origins: docs/measured.md); FOLDER contains imu_tk's `xsens_acc.mat`. The commands of
that page are run. Each comparison is one line, and the exit code is 1 if one differs.
"""

import json
import shlex
import sys
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from scipy.optimize import least_squares

from command_line import asked
from in_process import ran
from tumblecal.data import read_positions


SIX = """
[positions]
listed = [
  {name = "x_p", alpha_deg = 0, beta_deg = -90}, {name = "x_a", alpha_deg = 0, beta_deg = 90},
  {name = "y_p", alpha_deg = 90, beta_deg = 0}, {name = "y_a", alpha_deg = -90, beta_deg = 0},
  {name = "z_p", alpha_deg = 0, beta_deg = 0}, {name = "z_a", alpha_deg = 180, beta_deg = 0},
]
"""
STATIC_MIKOFF = "--static --rate 100 --columns ax=1,ay=2,az=3,gx=4,gy=5,gz=6 --gyro-unit rad/s --gravity 9.81"
STATIC_CARLSSON = "--static --topic {imu} --gravity 9.8184 --least-s 10"
MEANS_HASSAN = "--means --columns ax=vx_g,ay=vy_g,az=vz_g"
STATIC_BMI = "--static --rate 50 --scale 4 --unit g --columns temperature=1,ax=2,ay=3,az=4,gx=5,gy=6,gz=7"
IMU_TK = "--static --columns time=1,ax=2,ay=3,az=4 --unit 4069/g --offset ax=33124,ay=33275,az=32364"
PHONE = "hassan_lis3dh_30pos/MobileAccData30orientationRawSample01.mat"
# Printed by mikoff/imu-calib for its five units: scale %, misalignment deg (yz, xy, xz), bias m/s^2.
MIKOFF = [
    ((0.363, 0.315, 0.647), (0.123, 0.02, 0.317), (0.103, 0.097, 0.344)),
    ((0.471, 0.482, 0.932), (-0.284, -0.01, 0.145), (0.09, 0.07, 0.338)),
    ((0.382, 0.355, 0.78), (0.26, -0.012, 0.282), (0.096, 0.008, -0.045)),
    ((0.263, 0.448, 0.721), (-0.009, -0.028, -0.104), (0.065, 0.092, -0.009)),
    ((0.251, 0.286, 0.804), (0.056, 0.0, 0.191), (0.07, 0.036, 0.182)),
]
# Gauss-Newton of the repository of Hassan: bias in g, symmetric matrix.
HASSAN_BIAS = (8.532239735e-4, -5.181945155e-3, 1.355429928e-2)
HASSAN_MATRIX = (1.0075165464, -0.0077424535, 0.0265448295, 0.9969083368, 0.0017746069, 0.9933325356)
Line = tuple[str, bool]


def reduced(source: Path, out: Path, options: str) -> tuple[Path, str]:
    """Run `tumblecal reduce`; its folder, and its output."""
    outcome = ran(["reduce", source, *shlex.split(options), "--out", out])
    printed = outcome.told + outcome.printed + outcome.traceback
    if outcome.code:
        raise SystemExit(f"reduce {source} {options}: exit code {outcome.code}\n{printed}")
    return out, printed


def positions_of(folder: Path):
    """The position means that `reduce` wrote."""
    return read_positions(folder / "positions.csv")


def near(what: str, ours, theirs, tolerance: float) -> Line:
    """A line that compares two lists of numbers."""
    difference = float(np.max(np.abs(np.array(ours, float) - np.array(theirs, float))))
    return f"{what}: largest difference {difference:.2g} (allowed {tolerance:g})", difference <= tolerance


def counted(what: str, ours: int, theirs: int) -> Line:
    """A line that compares two counts."""
    return f"{what}: {ours} (known: {theirs})", ours == theirs


def mikoff(data: Path, out: Path) -> Iterator[Line]:
    """Five hand-held units; the published fit is T K (a - b) with |f| = 9.81 m/s^2, of its own intervals."""
    for unit, (scale, angles, bias) in enumerate(MIKOFF):
        folder, _ = reduced(data / "mikoff_mpu9150" / f"imu{unit}.log", out / f"m{unit}", STATIC_MIKOFF)
        a = 9.81 * positions_of(folder).readings

        def residuals(p: np.ndarray, a: np.ndarray = a) -> np.ndarray:
            upper = np.array([[1, p[0], p[1]], [0, 1, p[2]], [0, 0, 1]])
            return np.linalg.norm((a - p[6:]) * p[3:6] @ upper.T, axis=1) - 9.81

        p = least_squares(residuals, [0, 0, 0, 1, 1, 1, 0, 0, 0], x_scale=[0.01] * 9).x
        yield counted(f"mikoff imu{unit}: intervals", len(a), 22)
        yield near(f"mikoff imu{unit}: scale, %", 100 * (1 - p[3:6]), scale, 0.03)
        yield near(f"mikoff imu{unit}: misalignment, deg", -np.degrees([p[2], p[0], p[1]]), angles, 0.02)
        yield near(f"mikoff imu{unit}: bias, m/s^2", p[6:], bias, 0.003)


def suarez(data: Path, out: Path) -> Iterator[Line]:
    """Raw counts: the published intervals, and the published Allan deviations of 449 s at rest."""
    folder = data / "suarez_mpu6050"
    own, printed = reduced(folder / "example_data_calibration.csv", out / "s", "--static")
    yield "suarez: counts per g are guessed and reported", "guessed: 16384/g" in printed
    published = np.loadtxt(folder / "static_intervals.csv", delimiter=",").T
    used = json.loads((own / "reduction.json").read_text())["intervals"]
    spans = [(one["start"], one["stop"]) for one in used if one["used"]]
    longer = [(a, b) for a, b in published if b - a >= 50]
    hit = sum(any(min(b, y) - max(a, x) > 0.5 * min(b - a, y - x) for x, y in spans) for a, b in longer)
    yield counted("suarez: published intervals of half a second or more that are found", hit, len(longer))
    still, _ = reduced(folder / "example_data_tinit_calc.csv", out / "sr", "--static")
    axes = json.loads((still / "reduction.json").read_text())["axes"]
    for tau, known in ((1.0, (321, 306, 450)), (10.0, (116, 97, 148))):
        allan = [axis["allan"] for axis in axes.values()]
        ours = [np.interp(np.log(tau), np.log(a["tau_s"]), 1e6 * np.array(a["deviation_g"])) for a in allan]
        yield near(f"suarez: Allan deviation at {tau:g} s, ug", ours, known, 0.05 * max(known))


def carlsson(data: Path, out: Path) -> Iterator[Line]:
    """Frames of eight IMUs: twenty faces of the holder."""
    for name, outside in (("exp_1", 87), ("exp_7", 10)):
        source = data / "carlsson_mimu4444" / f"{name}.bin"
        for imu in ("imu1", "imu8"):
            folder, printed = reduced(source, out / f"{name}{imu}", STATIC_CARLSSON.format(imu=imu))
            yield counted(f"carlsson {name} {imu}: intervals of 10 s and more", len(positions_of(folder)), 20)
        words = f" {outside} of {source.stat().st_size} bytes are outside complete frames"
        yield f"carlsson {name}: all bytes but {outside} are complete frames", words in printed


def hassan(data: Path, out: Path) -> Iterator[Line]:
    """Means of 24 positions, .mat and text: bias and symmetric matrix of the repository, to all its digits."""
    folder = data / "hassan_lis3dh_30pos"
    text, _ = reduced(folder / "tab24.csv", out / "h", f"{MEANS_HASSAN} --unit g")
    mat, _ = reduced(folder / "CalibrationOfLowCostTriaxialInertialSensors.mat", out / "hm", "--means --unit g")
    a = positions_of(text).readings
    yield near("hassan: means of the .mat and of the text", positions_of(mat).readings, a, 1e-15)

    def residuals(p: np.ndarray) -> np.ndarray:
        matrix = np.array([[p[0], p[1], p[2]], [p[1], p[3], p[4]], [p[2], p[4], p[5]]])
        return np.linalg.norm((a - p[6:]) @ matrix.T, axis=1) - 1

    p = least_squares(residuals, [1, 0, 0, 1, 0, 1, 0, 0, 0], xtol=1e-15, ftol=1e-15, gtol=1e-15).x
    yield near("hassan: bias, g", p[6:], HASSAN_BIAS, 1e-9)
    yield near("hassan: symmetric matrix", p[:6], HASSAN_MATRIX, 1e-9)
    phone, _ = reduced(data / PHONE, out / "hp", "--static --rate 30 --columns ax=1,ay=2,az=3")
    # 30 orientations; in two of them the phone was moved by 5 degrees.
    yield counted("hassan: intervals of the phone", len(positions_of(phone)), 32)


def imucal(data: Path, out: Path) -> Iterator[Line]:
    """Six labelled positions in counts: the closed form of imucal (Ferraris), to all its digits."""
    folder, plan = data / "imucal_ferraris", out / "six.toml"
    plan.write_text(SIX)
    options = f"--by part --plan {plan} --rate 102.4 --unit 2048/g"
    positions = positions_of(reduced(folder / "annotated_session.csv", out / "i", options)[0])
    counts = dict(zip(positions.names, 2048 * positions.readings, strict=True))
    up, down = (np.stack([counts[f"{axis}_{side}"] for axis in "xyz"], axis=1) for side in "pa")
    known = json.loads((folder / "published_example_cal.json").read_text())
    difference = (up - down) / (2 * 9.81)
    scale = np.sqrt(np.diag(difference @ difference.T))
    yield near("imucal: bias, counts", np.diag(up + down) / 2, known["b_a"], 1e-10)
    yield near("imucal: scale, counts/(m/s^2)", scale, np.diag(known["K_a"]), 1e-10)
    yield near("imucal: rotation", difference / scale[:, None], known["R_a"], 1e-12)
    session, _ = reduced(folder / "example_ferraris_session.csv", out / "f", f"--plan {plan} --rate 102.4")
    missing = json.loads((session / "reduction.json").read_text())["plan"]["missing"]
    yield counted("imucal: positions of the plan missing in the unlabelled session", len(missing), 0)


def bmi270(data: Path, out: Path) -> Iterator[Line]:
    """Damaged serial logs: the lines without a complete reading."""
    for name, lines in (("BMI_270_cold_test_.csv", "9, 3258"), ("BMI_270_hot_test.csv", "2, 13, 6537")):
        _, printed = reduced(data / "bmi270_thermal" / name, out / name, STATIC_BMI)
        yield f"bmi270 {name}: lines {lines} left out", f"whole reading: {lines}" in printed


def imu_tk(folder: Path, out: Path) -> Iterator[Line]:
    """The Xsens recording of imu_tk: counts about 32768."""
    own, _ = reduced(folder / "xsens_acc.mat", out / "x", IMU_TK)
    yield counted("imu_tk: intervals", len(positions_of(own)), 38)


def main() -> None:
    """Compare."""
    given = asked(__doc__, data=(), imu_tk=Path)
    with TemporaryDirectory() as name:
        out = Path(name)
        parts = [(part, given.data) for part in (mikoff, suarez, carlsson, hassan, imucal, bmi270)]
        parts += [(imu_tk, given.imu_tk)] if given.imu_tk else []
        differ = 0
        for part, data in parts:
            for line, right in part(data, out):
                print(f"{'ok ' if right else 'DIFFERS'} {line}", flush=True)
                differ += not right
    sys.exit(bool(differ))


if __name__ == "__main__":
    main()
