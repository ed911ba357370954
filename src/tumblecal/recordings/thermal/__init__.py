"""Recordings over temperature as tables of bins: still attitudes, branches of the temperature, bin means with uncertainties."""
