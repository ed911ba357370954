"""Calibration over temperature: from means in temperature bins to parameters as functions of temperature."""
