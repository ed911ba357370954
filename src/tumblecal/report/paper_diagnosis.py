"""The diagnosis of Table 1 as a part of the study's page: the verdict, and what these 72 numbers could not have shown."""

from tumblecal.diagnosis import Diagnosis
from tumblecal.planning import NextPlan
from tumblecal.report.diagnosis_tables import invisible_table, limits_table
from tumblecal.report.diagnosis_verdict import verdict_of_diagnosis
from tumblecal.report.page import Section


def diagnosis_section(diagnosis: Diagnosis, plan: NextPlan) -> Section:
    """Verdict, detection limits of the visible effects, and the harm of the invisible ones."""
    return Section(
        "Diagnosis of Table 1",
        words=[
            *verdict_of_diagnosis(diagnosis, plan).words().splitlines(),
            "What these positions could and could not have shown:",
        ],
        tables=[limits_table(diagnosis), invisible_table(diagnosis)],
    )
