"""Usual sizes of parameters and of their change with temperature: priors of everything that a table does not determine."""

# At the reference temperature: sizes that data sheets of MEMS sensors allow (1, g, rad).
AT_REFERENCE = {"dK": 2e-2, "bias": 5e-2, "gamma": 5e-3}
# Change for 1 degC, by leaf.
SLOPE = {"bias": 5e-4, "dK": 1e-4, "gamma": 1e-5, "dtheta": 1e-5}
# Each order of temperature is smaller than the order below it by this factor.
NEXT_ORDER = 0.5
# Half-width of the effects of the history (hysteresis, lag, rate, drift) as a part of the change of the bias over the range.
HISTORY = 0.05
