"""Causes by name."""

from tumblecal.report.cause_words import label_words


def test_a_position_s_own_name_stays_whole():
    assert label_words(("bias_jump:m1:p0", "bias_jump:m5:p0")) == "bias_jump at m1:p0 + bias_jump at m5:p0"
