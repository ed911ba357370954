"""The source does not grow: each folder is within its budget, and the budget follows what was removed."""

import tomllib

import pytest

import size


def test_each_folder_is_within_its_budget():
    now, allowed = size.sizes(), size.budget()
    assert set(now) == set(allowed), (
        "a folder of src/ has no entry in tests/size_budget.toml, or an entry has no folder"
    )
    larger = [f"{name}: {now[name]}, at most {allowed[name]}" for name in sorted(now) if now[name] > allowed[name]]
    assert not larger, "\n".join(larger)


def test_the_budget_follows_what_was_removed():
    now, allowed = size.sizes(), size.budget()
    loose = [name for name in sorted(now) if now[name] < 0.99 * allowed[name] - 20]
    assert not loose, f"lower the budget of {', '.join(loose)}: python tests/size.py"


def test_each_raised_number_has_its_sentence_in_the_changelog():
    changelog = " ".join((size.ROOT / "CHANGELOG.md").read_text(encoding="utf-8").split())
    raised = tomllib.loads(size.BUDGET.read_text(encoding="utf-8")).get("raised", {})
    assert set(raised) <= set(size.budget())
    missing = [name for name, sentence in raised.items() if " ".join(sentence.split()) not in changelog]
    assert not missing


@pytest.mark.parametrize(
    ("source", "same"),
    [
        ("a = 1\nb = 2\n", "a = 1; b = 2\n"),
        ('def f():\n    """A text."""\n    return 1\n', "def f(): return 1\n"),
        ("x = (1 +\n     2)  # why\n", "x = 1 + 2\n"),
    ],
)
def test_layout_and_docstrings_have_no_size(source, same):
    assert size.size_of(source) == size.size_of(same)


def test_code_in_a_string_is_counted():
    code = "\n".join(f"value_{k} = value_{k} + {k}" for k in range(10))
    assert size.size_of(f"exec({code!r})") >= 50
