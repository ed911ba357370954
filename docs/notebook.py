# %% [markdown]
# # A calibration in a notebook
#
# Jupyter (with jupytext), VS Code, Spyder and PyCharm open this file as cells; `python docs/notebook.py` runs all of it.
# Start it in the root of the repository. A name on the last line of a cell shows one screen: what it is, a table with units,
# and the figure.

# %%
import tumblecal


tumblecal.enable_float64()  # before anything is computed

# %% [markdown]
# ## Data
# With a file of your own: `positions = tumblecal.read_positions("positions.csv")`. Here they are simulated, of an instrument
# with something in it that the nominal model does not know.

# %%
rig = tumblecal.read_rig("configs/hidden_effect.toml")
rig

# %%
positions = tumblecal.simulate(rig, seed=4)
positions

# %%
positions.table()  # polars: angles in deg, readings in g

# %% [markdown]
# ## Calibrate
# All methods; the exact fit is the one to take. Values and sd stand in the unit of their row: 1e-3, mg, mrad.

# %%
calibrated = tumblecal.calibrate(positions, noise_sd=0.1e-3)  # g
calibrated

# %%
calibrated.table()

# %%
calibrated.plot_methods()

# %% [markdown]
# `calibrated.exact` is the exact fit: `values` and `covariance` in base units (rad, g, 1), `residuals` in g.

# %%
exact = calibrated.exact
exact.value("bias_x"), exact.interval(0.95)[exact.names.index("bias_x")]

# %% [markdown]
# ## Diagnose
# The residuals are larger than the stated noise allows. Why?

# %%
diagnosis = tumblecal.diagnose(positions, noise_sd=0.1e-3)
diagnosis

# %%
diagnosis.table()  # the explanations; `alone`: without those that these data cannot tell from it

# %%
diagnosis.plot_columns()

# %%
diagnosis.extended.table()  # parameters of the extended model

# %%
diagnosis.plot_limits()  # what could still be hidden

# %%
tumblecal.next_plan(diagnosis).together  # positions to measure next

# %% [markdown]
# ## Save and apply
# The file is the one that `tumblecal apply` reads; `corrected` applies its nonlinear terms too. Readings and force are in g.

# %%
diagnosis.save("calibration.json")
calibration = tumblecal.load("calibration.json")
calibration

# %%
force = calibration.corrected(positions.readings, positions.temperature_degc)
force[:3]

# %% [markdown]
# Figures are matplotlib's: change and save them as any other.

# %%
figure = diagnosis.plot_residuals()
figure.suptitle(positions.source)
figure.savefig("residuals.png")
