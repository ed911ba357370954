"""Files of studies: every fault is told, with its path."""

from pathlib import Path

import pytest

from tumblecal.ground.errors import InputError
from tumblecal.studies.study_tables import read_study


def written(folder: Path, text: str) -> Path:
    path = folder / "study.toml"
    path.write_text(text)
    return path


@pytest.mark.parametrize(
    ("text", "word"),
    [
        ('[noise]\nsd = "1 mg"\nwhite = "1 mg"', "give one of"),
        ('[inject]\n"second_ordr.y" = 1', r"line 5: inject\.second_ordr\.y: no effect '.*did you mean second_order\.y"),
        ('[noise]\nsd = "0 mg"', r"line 5: noise\.sd: '0 mg': a standard deviation must be above 0"),
        ('[noise]\nwhite = "1e300 mg"', r"line 5: noise\.white: '1e300 mg': a standard .* 1e6 g\)$"),
    ],
)
def test_a_fault_is_told_with_its_path(tmp_path, configs, text, word):
    head = f'schema = "tumblecal.study.coverage/1"\nrig = "{configs / "paper24.toml"}"\ntrials = 10\n'
    with pytest.raises(InputError, match=word):
        read_study(written(tmp_path, head + text), "coverage")
