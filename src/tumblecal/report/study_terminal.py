"""What `tumblecal study` prints: the answer first, then the table behind it."""

from rich.console import Console

from tumblecal.report.narrow import print_table, print_words
from tumblecal.report.study_answers import Answer


def print_answer(answer: Answer, console: Console) -> None:
    """Print what a study found."""
    print_words(console, answer.headline, style="bold")
    for words in answer.words:
        print_words(console, words)
    print_table(console, answer.table.header, answer.table.rows, left=answer.table.text)
