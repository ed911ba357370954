"""The diagnosis of Table 1 as a part of the page of the study: verdict and detection limits."""

from tumblecal.diagnosis import Diagnosis
from tumblecal.planning import NextPlan
from tumblecal.report.diagnosis_tables import invisible_table, limits_table
from tumblecal.report.diagnosis_verdict import verdict_of_diagnosis
from tumblecal.report.page import Section


def diagnosis_section(diagnosis: Diagnosis, plan: NextPlan) -> Section:
    """Verdict, detection limits, and the changes that undetectable effects would cause."""
    return Section(
        "Diagnosis of Table 1",
        words=[
            *verdict_of_diagnosis(diagnosis, plan).words().splitlines(),
            "Detection limits with these positions, and undetectable effects:",
        ],
        tables=[limits_table(diagnosis), invisible_table(diagnosis)],
    )
