"""A user's script: a file, all methods, the calibration applied."""

import tumblecal


tumblecal.enable_float64()
data = tumblecal.simulate(tumblecal.read_rig("paper24"), seed=1)
calibrated = tumblecal.calibrate(data, noise_sd=0.15e-3)
for method, fit in calibrated.fits.items():
    print(method, fit.rms, fit.chi2_p_value, fit.values.shape)
calibrated.save("unit.json")
calibration = tumblecal.load("unit.json")
force = calibration.corrected(data.readings)
print(force.shape)
