"""Public recordings from their original files to verdicts: the commands of docs/recordings.md, and what `diagnose` says.

    python benchmarks/recording_verdicts.py DATA [--imu-tk FOLDER] [--only mikoff]

DATA and FOLDER as of recordings.py. For each file the options of `reduce`, whether `calibrate` says that its positions can be
used, and the first line of what `diagnose` says of them (an adequate set, a cause, or why it is refused).
"""

import argparse
import contextlib
import io
import shlex
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

from recordings import SIX
from tumblecal.cli.commands import run


BMI = "--static --rate 50 --scale 4 --unit g --columns temperature=1,ax=2,ay=3,az=4,gx=5,gy=6,gz=7"
COMMANDS = {
    **{f"mikoff_mpu9150/imu{unit}.log": "--static --rate 100 --gyro-unit rad/s --gravity 9.81" for unit in range(5)},
    "suarez_mpu6050/example_data_calibration.csv": "--static",
    "suarez_mpu6050/example_data_tinit_calc.csv": "--static",
    "carlsson_mimu4444/exp_1.bin": "--static --topic imu1 --gravity 9.8184 --least-s 10",
    "carlsson_mimu4444/exp_7.bin": "--static --topic imu1 --gravity 9.8184 --least-s 10",
    "hassan_lis3dh_30pos/tab24.csv": "--means --columns ax=vx_g,ay=vy_g,az=vz_g",
    "hassan_lis3dh_30pos/tab31.csv": "--means --columns ax=vx_g,ay=vy_g,az=vz_g",
    "hassan_lis3dh_30pos/tab49.csv": "--means --columns ax=vx_g,ay=vy_g,az=vz_g",
    "hassan_lis3dh_30pos/MobileAccData30orientationRawSample01.mat": "--static --rate 30",
    "imucal_ferraris/annotated_session.csv": "--by part --plan six.toml --rate 102.4",
    "imucal_ferraris/example_ferraris_session.csv": "--plan six.toml --rate 102.4",
    "bmi270_thermal/BMI_270_hot_test.csv": BMI,
    "bmi270_thermal/BMI_270_cold_test_.csv": BMI,
}
# Six faces alone do not tell the pitch errors of a head from the axes' angles.
BESIDE = {"imucal_ferraris": ["--fix", "dbeta"]}
IMU_TK = "--static --columns time=1,ax=2,ay=3,az=4 --unit 4069/g --offset ax=33124,ay=33275,az=32364"


def said_by(*arguments: str) -> tuple[int, str]:
    """Exit code of a command, and the line that judges: the first, or that which says whether to use a calibration."""
    out, fault = io.StringIO(), io.StringIO()
    sys.argv = ["tumblecal", *arguments]
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(fault):
        code = run()
    lines = (fault if code else out).getvalue().strip().splitlines()
    judging = [line for line in lines if line.startswith(("Usable", "Use it only", "Do not use", "Not tested"))]
    words = (judging or lines or [""])[0]
    return code, "values and sd" if arguments[0] == "calibrate" and not (code or judging) else words


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("data", type=Path)
    parser.add_argument("--imu-tk", type=Path)
    parser.add_argument("--only", default="")
    asked = parser.parse_args()
    listed = {asked.data / name: options for name, options in COMMANDS.items()}
    if asked.imu_tk:
        listed[asked.imu_tk / "xsens_acc.mat"] = IMU_TK
    with TemporaryDirectory() as name:
        plan = Path(name) / "six.toml"
        plan.write_text(SIX)
        for source, options in listed.items():
            if asked.only not in str(source):
                continue
            folder = Path(name) / f"{source.parent.name}-{source.stem}"
            words = shlex.split(options.replace("six.toml", str(plan)))
            code, said = said_by("reduce", str(source), *words, "--out", str(folder), "--no-figures")
            print(f"{source.parent.name}/{source.name}: reduce {options}")
            for command in () if code else ("calibrate", "diagnose"):
                out = ["--out", str(folder / command), "--no-figures", *BESIDE.get(source.parent.name, [])]
                code, said = said_by(command, str(folder / "positions.csv"), *out)
                print(f"    {command}: {said.replace(str(folder), '')[:260]}", flush=True)
            if code == 2 and not (folder / "positions.csv").exists():
                print(f"    reduce: {said}")


if __name__ == "__main__":
    main()
