"""Plans of random and typical heads: their bounds, orders and promises."""

import tumblecal


tumblecal.enable_float64()
