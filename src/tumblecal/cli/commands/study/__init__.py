"""`tumblecal study`: large simulations, one subcommand for each kind of study."""

from cyclopts import App


study = App(
    name="study",
    help="Simulate thousands to millions of calibrations: convergence, linearization, coverage, sweep, power.",
    result_action="return_value",
)
KINDS = {
    "coverage": "Check estimates and stated uncertainties: estimation bias, dispersion, chi2, interval coverage.",
    "convergence": "Find the number of data sets that each method needs for a given error.",
    "linearization": "Find the largest errors for which the small-angle equations are adequate.",
    "sweep": "Run a coverage study over a grid of values of rig, plan, noise or injected effects.",
    "power": "Find how often effects of given sizes are detected and correctly identified.",
}
for _kind, _help in KINDS.items():
    study.command(f"tumblecal.cli.commands.study.kinds:{_kind}", name=_kind, help=_help)
