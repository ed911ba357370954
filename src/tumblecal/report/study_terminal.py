"""What `tumblecal study` prints: the answer first, then the table behind it."""

from rich.console import Console
from rich.table import Table

from tumblecal.report.study_answers import Answer


def print_answer(answer: Answer, console: Console) -> None:
    """Print what a study found."""
    console.print(answer.headline, style="bold", highlight=False)
    for words in answer.words:
        console.print(words, highlight=False)
    table = Table(box=None, header_style="bold", pad_edge=False)
    for place, title in enumerate(answer.table.header):
        table.add_column(title, justify="left" if place in answer.table.text else "right")
    for row in answer.table.rows:
        table.add_row(*row)
    console.print(table)
