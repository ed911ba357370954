"""Faults of the procedure: single positions, labels, axes, units. These act on the data, not in the chain."""

from tumblecal.effects.effect import Effect


_SOURCE = "laboratory practice; data snooping after Baarda (1968)"


def _entry(id: str, physics: str, cause: str, advice: str) -> Effect:
    return Effect(id, physics, "", 0.0, cause, advice, _SOURCE, kind="data")


ENTRIES = (
    _entry(
        "outlier_position",
        "an unknown error of one position on each axis",
        "One position was disturbed: a knock, a wrong clamping, someone touching the table.",
        "Measure this position again, or remove it.",
    ),
    _entry(
        "swapped_positions",
        "the readings of two positions exchanged",
        "The readings of two positions are exchanged.",
        "Compare with the log; exchange the two rows.",
    ),
    _entry(
        "mislabelled_angle",
        "an angle of one position in error by a step of the plan",
        "The head was one step of the plan away from the recorded angle.",
        "Compare with the log; correct the angle of this row.",
    ),
    _entry(
        "bias_jump",
        "a different bias of one axis from one position on",
        "The bias of an axis jumped at this position and stayed there (a knock, a restart, a supply that switched).",
        "Compare with the log; repeat the first positions, and label the later positions as a new run.",
    ),
    _entry(
        "mount_slip",
        "the triad turned by a small angle in its fixture from one position on",
        "The triad slipped in its fixture at this position and stayed there.",
        "Clamp it again; label the later positions as a new mount in the file.",
    ),
    _entry(
        "axis_map",
        "axes exchanged or with the wrong sign",
        "The axes of the file are not those of the plan: exchanged, or of opposite sign.",
        "Check the data sheet's axis drawing and the order of the columns; rename or negate the columns.",
    ),
    _entry(
        "unit_error",
        "g, mg and m/s^2 confused",
        "Readings are not in the unit of their column.",
        "Rename the columns (ax_g, ax_mg, ax_ms2) or convert the numbers.",
    ),
    _entry(
        "decimal_slip",
        "the decimal point of single readings misplaced",
        "The decimal point of a reading, or of a row of readings, is missing or misplaced.",
        "Compare with the log; correct the numbers.",
    ),
    _entry(
        "triad_turned",
        "the triad turned by quarter turns in its fixture",
        "The triad is turned in its fixture.",
        "State the turn in a rig file (mounts), or name the columns by the axes of the head.",
    ),
    _entry(
        "angles_exchanged",
        "alpha and beta exchanged",
        "The columns of the spindle angle and of the pitch angle are exchanged.",
        "Exchange the names of the two columns.",
    ),
    _entry(
        "pitch_reversed",
        "90 deg - beta, or -beta, in place of beta",
        "The pitch angle is measured from the other end of its scale, or with the opposite sign.",
        "Measure beta from the level spindle, positive as in the drawing of the frames; correct the column.",
    ),
    _entry(
        "spindle_reversed",
        "-alpha in place of alpha, everywhere or at one pitch setting; readings of a setting in reverse order",
        "The spindle angle has the opposite sign, or the spindle was turned backwards.",
        "Compare with the log; change the sign of alpha, or the order of the rows, there.",
    ),
    _entry(
        "index_offset",
        "a constant error of alpha at a pitch setting, or in all positions",
        "The spindle angle was measured from another hole or zero of its index.",
        "Compare with the log; add the angle to alpha there.",
    ),
    _entry(
        "rows_shifted",
        "the readings of each row in the row after or before it, all or from some row on",
        "A row of readings was omitted, or written twice, or angles and readings begin in different rows.",
        "Compare with the log; move the readings by one row.",
    ),
    _entry(
        "settings_exchanged",
        "the beta of two pitch settings exchanged",
        "Two pitch settings have each other's label.",
        "Compare with the log; exchange the two values of beta.",
    ),
    _entry(
        "mislabelled_setting",
        "beta of one pitch setting in error by several degrees",
        "At one pitch setting the pitch angle differed from its label.",
        "Read the scale again; correct beta of this setting.",
    ),
    _entry(
        "temperature_unit",
        "kelvin in a column of degC",
        "Temperatures are in kelvin.",
        "Subtract 273.15.",
    ),
    _entry(
        "time_restarts",
        "time set back to its start within the file",
        "The clock was reset between parts of the measurement.",
        "Label each part as a separate run, with times that continue.",
    ),
)
