"""What goes wrong in the procedure: single positions, labels, axes, units. These act on the data, not in the chain."""

from tumblecal.effects.effect import Effect


_SOURCE = "laboratory practice; data snooping after Baarda (1968)"


def _entry(id: str, physics: str, cause: str, advice: str) -> Effect:
    return Effect(id, physics, "", 0.0, cause, advice, _SOURCE, kind="data")


ENTRIES = (
    _entry(
        "outlier_position",
        "one position off by an unknown amount on each axis",
        "One position was disturbed: a knock, a wrong clamping, someone touching the table.",
        "Measure this position again, or leave it out.",
    ),
    _entry(
        "swapped_positions",
        "the readings of two positions exchanged",
        "The readings of two positions stand in each other's place.",
        "Compare with the log; exchange the two rows.",
    ),
    _entry(
        "mislabelled_angle",
        "an angle of one position off by a step of the plan",
        "The head stood one step of the plan away from the angle written down.",
        "Compare with the log; correct the angle of this row.",
    ),
    _entry(
        "bias_jump",
        "another bias of one axis from one position on",
        "The bias of an axis jumped at this position and stayed there (a knock, a restart, a supply that switched).",
        "Compare with the log; repeat the first positions, and give what follows a run of its own.",
    ),
    _entry(
        "mount_slip",
        "the triad turned by a small angle in its fixture from one position on",
        "The triad slipped in its fixture at this position and stayed there.",
        "Clamp it again; give what follows a mount of its own in the file.",
    ),
    _entry(
        "axis_map",
        "axes exchanged or with the wrong sign",
        "The axes of the file are not those of the plan: exchanged, or of opposite sign.",
        "Check the data sheet's axis drawing and the order of the columns; rename or negate the columns.",
    ),
    _entry(
        "unit_error",
        "g, mg and m/s^2 mixed up",
        "Readings are in another unit than their column says.",
        "Rename the columns (ax_g, ax_mg, ax_ms2) or convert the numbers.",
    ),
    _entry(
        "decimal_slip",
        "the decimal point of single readings off by some places",
        "The decimal point of a reading, or of a row of them, was lost or stands in another place.",
        "Compare with the log; correct the numbers.",
    ),
    _entry(
        "triad_turned",
        "the triad turned by quarter turns in its fixture",
        "The triad stands turned in its fixture.",
        "State the turn in a rig file (mounts), or name the columns by the axes of the head.",
    ),
    _entry(
        "angles_exchanged",
        "alpha and beta exchanged",
        "The columns of the spindle angle and of the pitch angle stand in each other's place.",
        "Exchange the names of the two columns.",
    ),
    _entry(
        "pitch_reversed",
        "90 deg - beta, or -beta, in place of beta",
        "The pitch angle is counted from the other end of its scale, or in the other sense.",
        "Count beta from the spindle being level, positive as in the drawing of the frames; correct the column.",
    ),
    _entry(
        "spindle_reversed",
        "-alpha in place of alpha, everywhere or at one pitch setting; readings of a setting in reverse order",
        "The spindle angle is counted in the other sense, or the spindle was turned back again.",
        "Compare with the log; change the sign of alpha, or the order of the rows, there.",
    ),
    _entry(
        "index_offset",
        "alpha off by one angle at a pitch setting, or throughout",
        "The spindle was counted from another hole or zero of its index.",
        "Compare with the log; add the angle to alpha there.",
    ),
    _entry(
        "rows_shifted",
        "the readings of each row in the row after or before it, all or from some row on",
        "A row of readings was left out, or written twice, or angles and readings begin in different rows.",
        "Compare with the log; move the readings by a row.",
    ),
    _entry(
        "settings_exchanged",
        "the beta of two pitch settings exchanged",
        "Two pitch settings have each other's label.",
        "Compare with the log; exchange the two values of beta.",
    ),
    _entry(
        "mislabelled_setting",
        "beta of one pitch setting off by several degrees",
        "At one pitch setting the head stood elsewhere than its label says.",
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
        "The clock was set back between parts of the measurement.",
        "Give each part a run of its own, and times that go on.",
    ),
)
