"""What everything stands on: axes, gravity, text and TOML files read strictly. numpy at most, no JAX."""
