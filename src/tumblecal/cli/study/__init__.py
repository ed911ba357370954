"""`tumblecal study`: simulation at scale, one subcommand a kind of study."""

from cyclopts import App


study = App(
    name="study",
    help="Simulate thousands to millions of calibrations: convergence, linearization, coverage, sweep, power.",
    result_action="return_value",
)
KINDS = {
    "coverage": "Bias, sd against predicted, chi2 and interval coverage.",
    "convergence": "Number of data sets that each method needs to reach a given error.",
    "linearization": "Up to which errors the small-angle equations are good enough.",
    "sweep": "A coverage study over a grid of any values of rig, plan, noise or injected effects.",
    "power": "How often effects are detected and named rightly, over their size.",
}
for _kind, _help in KINDS.items():
    study.command(f"tumblecal.cli.study.{_kind}:{_kind}", name=_kind, help=_help)
