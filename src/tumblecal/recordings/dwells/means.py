"""Positions of a table with one mean in each row."""

from pathlib import Path

from tumblecal.capture.capture_plan import CapturePlan
from tumblecal.data.raw import read_raw
from tumblecal.ground.atomic import scratch_folder
from tumblecal.ground.errors import InputError
from tumblecal.ground.gravity import stated_gravity
from tumblecal.recordings.dwells.axis_checks import require_axes_answer
from tumblecal.recordings.dwells.dwell_samples import DwellSamples, stated_comments
from tumblecal.recordings.dwells.place import Place, position_set
from tumblecal.recordings.dwells.plan_match import matched
from tumblecal.recordings.options import KnownContext, RecordingOptions
from tumblecal.recordings.reading import read_recording


def means_of(path: Path, known: tuple[KnownContext, CapturePlan | None], options: RecordingOptions) -> DwellSamples:
    """The positions of a table of means: spreadsheets, .mat files and text of any layout.

    **Arguments:**

    - `known`: context, and its plan, whose positions are found by name, otherwise by the direction of gravity.

    **Raises:** `InputError` for a table without accelerations, or with positions that are not in the plan.
    """
    context, plan = known
    with scratch_folder(path) as folder:
        samples = folder / "means.parquet"
        recording = read_recording(path, samples, options, by=context.by, in_g=True, means=True)
        raw = read_raw(samples, path)
        there = set(raw.frame.columns)
        with_angles = plan is None and {"alpha_deg", "beta_deg"} <= there
        comments = stated_comments(samples, path, plan, hand_held=plan is None and not with_angles)
    raw = raw.in_g_of(stated_gravity(comments, str(path))) if raw.in_ms2 else raw
    require_axes_answer(str(path), raw.readings[:, None])
    names = [f"p{k + 1}" for k in range(len(raw.readings))]
    names = raw.frame["position"].cast(str).to_list() if "position" in there else names
    places = [Place(name) for name in names]
    if with_angles:
        angles = (raw.numbers(name).tolist() for name in ("alpha_deg", "beta_deg"))
        places = [Place(*row) for row in zip(names, *angles, strict=True)]
    if plan is not None:
        steps = matched(raw.readings, plan).positions.tolist()
        if "position" in there:
            numbers = {str(step.name): k for k, step in enumerate(plan.steps)}
            steps = [numbers.get(name, -1) for name in names]
        if -1 in steps:
            raise InputError(
                f"{path}: row {steps.index(-1) + 1}: not a position of the plan ({steps.count(-1)} such rows); remove them"
            )
        places = [place.at_step(plan, step) for place, step in zip(places, steps, strict=True)]
    columns = {
        "temperature_degc": raw.temperature_degc(),
        "time_s": raw.numbers("time_s") if "time_s" in there else None,
    }
    positions = position_set(str(path), raw.readings, places, comments, known, **columns)
    return DwellSamples(positions, read=(recording,), warnings=((str(path), recording.damage.lines),))
